// Plausibility checks of a Falcon's reports.
#pragma once

#include "devices/falcon/calibration.h"

#include <cstdint>
#include <optional>

namespace haptrace {

/// Derives the pose of the legs from reports. Packets have no check sum, and until a leg is homed, its encoder counts
/// from its position at power-on. So there is no pose before all three legs are homed and their counts have settled.
/// The tracker doubts a report if
///
///     a leg is no longer homed, or moved faster than a hand can move it, or the legs cannot hold the handle.
///
/// It doubts counts that jumped until they are nearer again to the last believed counts. A doubt that lasts for
/// kPatience counts as real: the homing or the device is lost.
///
/// Times are of any clock that does not go back.
///
/// Threads: one at a time. Real-time: all but what throws.
class FalconTracker {
 public:
  static constexpr double kFastestLeg = 100;  ///< [rad/s]; the handle then moves at 3 to 10 m/s
  static constexpr double kSampleAge = 1e-3;  ///< age of a report's counts when its packet is sent [s]
  static constexpr double kPatience = 0.03;   ///< [s]
  static constexpr int kSettled = 10;         ///< consecutive reports

  explicit FalconTracker(const FalconCalibration& calibration)
      : calibration_(calibration), kinematics_(calibration.geometry) {}

  enum class [[nodiscard]] Verdict : std::uint8_t{
      unhomed,   ///< there is no pose
      believed,  ///< the pose is that of the report
      doubted,   ///< the pose is the last believed one
  };

  /// Takes a report. `sent_ns` is the time at which the packet that it answers was sent. Throws Error(device) if the
  /// device is lost.
  Verdict take(const FalconReport& report, std::int64_t sent_ns, std::int64_t received_ns);

  /// Returns the pose in B; null while there is none.
  [[nodiscard]] const FalconPose* pose() const noexcept { return pose_ ? &*pose_ : nullptr; }

 private:
  enum class Doubt : std::uint8_t { none, homing, jump, nowhere };

  Verdict settle(const FalconReport& report) noexcept;
  [[nodiscard]] Doubt examine(const FalconReport& report, std::optional<FalconPose>& pose) const noexcept;
  [[nodiscard]] bool jumped(const FalconReport& report) const noexcept;
  [[noreturn]] void lose(Doubt why, const FalconReport& report) const;

  FalconCalibration calibration_;
  FalconKinematics kinematics_;
  std::optional<FalconPose> pose_;
  FalconReport last_;         ///< last report that is believed, or may be once settled
  std::int64_t last_ns_ = 0;  ///< time at which its packet was sent [ns]
  double elapsed_ = 0;        ///< longest time between its sampling and that of the newest report [s]
  int settled_ = 0;           ///< consecutive reports without a jump

  Doubt doubt_ = Doubt::none;
  FalconReport doubted_;         ///< first doubted report, as long as there is doubt
  std::int64_t doubted_ns_ = 0;  ///< time at which its packet was sent [ns]
};

/// Detects encoders that do not count although the motors push: a connector inside came off, or the firmware hangs. It
/// reacts if an encoder stands still while the counts sent to its motor change by half of the largest counts, and for
/// kPatience afterwards. Under a small or constant force this cannot be distinguished from a hand that holds still.
/// After a gap in the reports it restarts, because the motor counts sent meanwhile are unknown: a guardian may have
/// acted.
///
/// Threads: one at a time. Real-time: all but what throws.
class FalconEncoderWatch {
 public:
  static constexpr double kPatience = 0.5;  ///< [s]

  explicit FalconEncoderWatch(int max_motor_counts) : much_(max_motor_counts / 2) {}

  /// Takes the encoders and the motor counts of a round. Throws Error(device) naming the leg.
  void take(const std::array<std::int16_t, 3>& encoders, const std::array<std::int16_t, 3>& motors,
            std::int64_t now_ns);

 private:
  struct Leg {
    int encoder = 0, least = 0, most = 0;  ///< [counts]; range sent to the motor since the encoder moved
    std::int64_t pushed_ns = -1;           ///< time at which that range exceeded much_; negative: not yet
  };

  int much_;
  std::int64_t last_ns_ = 0;
  std::array<Leg, 3> legs_;
};

}  // namespace haptrace
