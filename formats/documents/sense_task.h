// Position sense of a hand that the device moves: pairs of places, of which the participant names the farther one.
#pragma once

#include "control/path/path.h"

#include <array>
#include <nlohmann/json.hpp>
#include <vector>

namespace haptrace {

class JsonReader;

/// A forced choice between two places on a line. The device moves the hand from the start to the first place and back,
/// then to the second place and back; the participant says which was farther. The nearer one is always at `reference`.
/// Places are in the coordinates of the exercise.
struct SenseTask {
  static constexpr double kPause = 0.5;  ///< in the start, between the places [s]

  Vec3 start = Vec3::Zero();                                          ///< [m]
  Vec3 axis = Vec3::UnitX();                                          ///< unit vector from the start to the places
  double reference = 0.03;                                            ///< distance of the nearer place [m]
  std::vector<double> differences{0.002, 0.004, 0.006, 0.01, 0.016};  ///< of the two distances [m], ascending
  int tries = 24;                                                     ///< for each difference, even
  double move = 1, stay = 1;  ///< duration of each of the four movements, and of the stay at each place [s]
  double answer = 15;         ///< time for the answer [s]

  [[nodiscard]] int trials() const noexcept { return tries * static_cast<int>(differences.size()); }
  /// Returns 2 n differences, of the second place less the first one [m]: n negative ones, then n positive ones.
  [[nodiscard]] std::vector<double> pairs() const;
  /// Returns the duration of the movement of a pair [s].
  [[nodiscard]] double duration() const noexcept;
};

/// Reads the object `sense` of an exercise. Throws Error(input) naming the key.
SenseTask read_sense_task(JsonReader reader);

/// One trial of the schedule, and its answer.
struct SenseTrial {
  int pair = 0;    ///< as pairs() numbers them
  int answer = 0;  ///< 1 or 2: the place that the participant named as the farther one; 0: none yet

  bool operator==(const SenseTrial&) const = default;
};

nlohmann::json json_of(const SenseTrial& trial);
SenseTrial sense_trial_from(JsonReader reader);

/// Returns the movement of a pair. `task.start` and `task.axis` may be in W, the axis with the scale of the exercise.
Path path_of_pair(const SenseTask& task, int pair);

/// When a recording of a pair shows the two places, and along which direction they differ.
struct SensePair {
  static constexpr double kLargestError = 2e-3;  ///< of the difference, in a trial that counts, or half of it [m]

  Vec3 axis = Vec3::UnitX();      ///< in W
  std::array<double, 2> first{};  ///< begin and end of the second half of the stay, since the movement began [s]
  std::array<double, 2> second{};
  double difference = 0;  ///< as planned: distance of the second place less the first one [m]
};

/// Returns where a pair is measured. `task.axis` is in W, with the scale of the exercise.
SensePair sense_pair(const SenseTask& task, int pair);

/// Returns the object that the config of a recording keeps as `sense`, and reads it.
nlohmann::json json_of(const SensePair& pair);
SensePair sense_pair_from(JsonReader reader);

}  // namespace haptrace
