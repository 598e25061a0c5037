// What of a Falcon's reports can be believed.
#pragma once

#include "devices/falcon/calibration.h"

#include <cstdint>
#include <optional>

namespace haptrace {

/// From reports to the pose of the legs. A packet has no check sum, and encoders count from wherever they were when the
/// power came on until their legs are homed. So there is no pose before all three are homed and their counts have
/// settled; and a report is doubted which says that
///
///     a leg is not homed any more, or moved faster than a hand can move it, or the legs hold the handle nowhere.
///
/// Counts that jumped are doubted until they are nearer again to those believed last. What is doubted for kPatience is
/// true: homing was lost, or the device is.
///
/// Times are of any clock that does not go back.
///
/// Threads: one at a time. Real-time: all but what throws.
class FalconTracker {
 public:
  static constexpr double kFastestLeg = 100;  ///< the handle then moves at 3 to 10 m/s [rad/s]
  static constexpr double kSampleAge = 1e-3;  ///< of what a report says, when its packet is sent [s]
  static constexpr double kPatience = 0.03;   ///< [s]
  static constexpr int kSettled = 10;         ///< reports in a row

  explicit FalconTracker(const FalconCalibration& calibration)
      : calibration_(calibration), kinematics_(calibration.geometry) {}

  enum class [[nodiscard]] Verdict : std::uint8_t{
      unhomed,   ///< there is no pose
      believed,  ///< the pose is that of the report
      doubted,   ///< the pose is the last that was believed
  };

  /// `sent_ns` is when the packet was sent that the report answers. Throws Error(device) when the device is lost.
  Verdict take(const FalconReport& report, std::int64_t sent_ns, std::int64_t received_ns);

  /// In B. Null while there is none.
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
  FalconReport last_;         ///< that was believed, or may be once it has settled
  std::int64_t last_ns_ = 0;  ///< when its packet was sent
  double elapsed_ = 0;        ///< between its sampling and that of the newest, at most [s]
  int settled_ = 0;           ///< reports

  Doubt doubt_ = Doubt::none;
  FalconReport doubted_;         ///< the first, as long as there is doubt
  std::int64_t doubted_ns_ = 0;  ///< when its packet was sent
};

/// Encoders that do not count although motors push: a plug inside that came off, or firmware that hangs. Noticed once
/// the counts that a motor is sent have changed by half of the largest while its encoder has stood still, and it goes
/// on standing still for kPatience. Under a force that is small or does not change, nobody can tell it from a hand that
/// holds still. After a gap of reports it begins anew, since nobody knows what the motors were sent meanwhile: a
/// guardian may have spoken.
///
/// Threads: one at a time. Real-time: all but what throws.
class FalconEncoderWatch {
 public:
  static constexpr double kPatience = 0.5;  ///< [s]

  explicit FalconEncoderWatch(int max_motor_counts) : much_(max_motor_counts / 2) {}

  /// Throws Error(device) naming the leg.
  void take(const std::array<std::int16_t, 3>& encoders, const std::array<std::int16_t, 3>& motors,
            std::int64_t now_ns);

 private:
  struct Leg {
    int encoder = 0, least = 0, most = 0;  ///< [counts]; what the motor was sent since the encoder moved
    std::int64_t pushed_ns = -1;           ///< when that had changed by much
  };

  int much_;
  std::int64_t last_ns_ = 0;
  std::array<Leg, 3> legs_;
};

}  // namespace haptrace
