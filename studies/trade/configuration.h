// One way to run a session: what it is made of, how fast it runs, and how much of its path it keeps.
#pragma once

#include "control/path/trajectory.h"
#include "player/playback/playback.h"
#include "player/tuning/live_tuning.h"

#include <string>

namespace haptrace {

/// A playback, by everything that buys speed with accuracy.
struct Configuration {
  double rate_hz = 1000;
  Interpolation interpolation = Interpolation::cubic;
  std::string velocity = "lowpass:100";  ///< see make_velocity_estimator
  Compensations with;                    ///< beside the PD law; learning goes by `learn`
  int learn = 0;                         ///< repetitions to learn from; figures are those of the last
  int thin = 1;                          ///< every so many-th sample of the path is kept
  double speed = 1;                      ///< of the path's own

  bool operator==(const Configuration&) const = default;
};

/// "1000 Hz, cubic, lowpass:100, inertia + observer, 5 repetitions learned, every 10th sample": for people.
std::string describe(const Configuration& configuration);

/// What of a session is compensated, as in "gravity + observer"; "PD alone".
std::string describe(const Compensations& with);

/// `base` as the configuration has it. The gains stay those of the base, or absent: those of the device that was
/// identified.
PlayOptions play_options(const Configuration& configuration, const PlayOptions& base);

/// The same as a file for --config, with a section for each of play, guide and record, and what `base` says of the
/// path. `profile`: the file of the device's profile, or empty. `storage` may be null: recordings are stored as they
/// are.
nlohmann::json config_file(const Configuration& configuration, const PlayOptions& base, const std::string& profile,
                           const Storage* storage);

nlohmann::json to_json(const Configuration& configuration);

}  // namespace haptrace
