// Configuration of a session: its terms, its rate and the thinning of its path.
#pragma once

#include "control/path/trajectory.h"
#include "player/playback/playback.h"
#include "player/tuning/live_tuning.h"

#include <array>
#include <string>

namespace haptrace {

/// Laws of a calibrated device: the one with a disturbance observer, and the LQG laws by firmness.
inline constexpr std::array kLawNames{"observer", "quiet", "normal", "exact"};

/// Options of a playback that trade speed against accuracy.
struct Configuration {
  double rate_hz = 1000;
  Interpolation interpolation = Interpolation::cubic;
  std::string velocity = "lowpass:100";  ///< see make_velocity_estimator
  Compensations with;                    ///< terms besides the PD law; `learn` decides about learning
  std::string law;                       ///< of a calibrated device with the observer: kLawNames; empty: see play()
  int learn = 0;                         ///< repetitions to learn from; metrics are those of the last
  int thin = 1;                          ///< keep every N-th sample of the path
  double speed = 1;                      ///< speed relative to the path's own

  bool operator==(const Configuration&) const = default;
};

/// Returns true for the LQG laws among kLawNames.
bool is_lqg(const std::string& law) noexcept;

/// Returns a description: "1000 Hz, cubic, lowpass:100, inertia + observer, 5 repetitions learned, every 10th sample".
std::string describe(const Configuration& configuration);

/// Returns the compensations, as in "gravity + observer", or "PD alone".
std::string describe(const Compensations& with);

/// Returns `base` with the options of `configuration`. Gains of the base stay; if absent, those of the identified
/// device apply.
PlayOptions play_options(const Configuration& configuration, const PlayOptions& base);

/// Returns the configuration as a file for --config, with a section each for play, guide and record, and the path
/// options of `base`. `profile`: file of the device's profile, or empty. `storage`: storage of recordings, or null for
/// the default.
nlohmann::json config_file(const Configuration& configuration, const PlayOptions& base, const std::string& profile,
                           const Storage* storage);

nlohmann::json to_json(const Configuration& configuration);

}  // namespace haptrace
