#include "devices/falcon/tracker.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr const char* kHomeAgain = "check its cables, switch its power off and on, and home it again";

double falcon_seconds(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-9 * static_cast<double>(to_ns - from_ns);
}

/// Returns the largest encoder difference of any leg [counts].
int largest_move(const FalconReport& one, const FalconReport& other) {
  int largest = 0;
  for (std::size_t leg = 0; leg < 3; ++leg)
    largest = std::max(largest, std::abs(one.encoders[leg] - other.encoders[leg]));
  return largest;
}

}  // namespace

FalconTracker::Verdict FalconTracker::take(const FalconReport& report, std::int64_t sent_ns, std::int64_t received_ns) {
  elapsed_ = falcon_seconds(last_ns_, received_ns) + kSampleAge;
  if (!pose_) {
    const Verdict verdict = settle(report);
    last_ns_ = sent_ns;
    return verdict;
  }
  std::optional<FalconPose> pose;
  const Doubt doubt = examine(report, pose);
  if (doubt == Doubt::none) {
    doubt_ = Doubt::none;
    pose_ = pose;
    last_ = report;
    last_ns_ = sent_ns;
    return Verdict::believed;
  }
  if (doubt_ == Doubt::none) {
    doubt_ = doubt;
    doubted_ = report;
    doubted_ns_ = sent_ns;
  }
  if (falcon_seconds(doubted_ns_, sent_ns) < kPatience) return Verdict::doubted;
  if (doubt != Doubt::homing) lose(doubt, report);
  pose_.reset();
  doubt_ = Doubt::none;
  settled_ = 0;
  return Verdict::unhomed;
}

FalconTracker::Verdict FalconTracker::settle(const FalconReport& report) noexcept {
  settled_ = !report.is_homed() ? 0 : jumped(report) ? 1 : settled_ + 1;
  last_ = report;
  if (settled_ >= kSettled) pose_ = kinematics_.at_angles(calibration_.angles(report.encoders));
  return pose_ ? Verdict::believed : Verdict::unhomed;
}

FalconTracker::Doubt FalconTracker::examine(const FalconReport& report,
                                            std::optional<FalconPose>& pose) const noexcept {
  if (!report.is_homed()) return Doubt::homing;
  if (jumped(report)) return Doubt::jump;
  if (doubt_ == Doubt::jump && largest_move(report, doubted_) < largest_move(report, last_)) return Doubt::jump;
  pose = kinematics_.at_angles(calibration_.angles(report.encoders), pose_->position);
  return pose ? Doubt::none : Doubt::nowhere;
}

/// Returns whether a leg moved faster since the last report than it can.
bool FalconTracker::jumped(const FalconReport& report) const noexcept {
  const Vec3 most = kFastestLeg * elapsed_ * calibration_.counts_per_rad;
  for (std::size_t leg = 0; leg < 3; ++leg)
    if (std::abs(report.encoders[leg] - last_.encoders[leg]) > most[static_cast<int>(leg)]) return true;
  return false;
}

void FalconTracker::lose(Doubt why, const FalconReport& report) const {
  if (why == Doubt::jump)
    throw device_error(
        fmt::format("its encoders jumped from {} to {} counts and stayed there, farther than a hand can move them: "
                    "counts or the homing were lost; {}",
                    fmt::join(last_.encoders, ", "), fmt::join(report.encoders, ", "), kHomeAgain));
  const Vec3 degrees = calibration_.angles(report.encoders) * (180 / std::numbers::pi);
  throw device_error(fmt::format(
      "its legs are at {:.0f}, {:.0f} and {:.0f} degrees, and no position of the handle has these angles: its homing "
      "was lost, or the calibration belongs to another device (home_angle, encoder_sign, geometry); {}",
      degrees[0], degrees[1], degrees[2], kHomeAgain));
}

void FalconEncoderWatch::take(const std::array<std::int16_t, 3>& encoders, const std::array<std::int16_t, 3>& motors,
                              std::int64_t now_ns) {
  const bool anew = falcon_seconds(last_ns_, now_ns) > kPatience / 5;
  last_ns_ = now_ns;
  for (std::size_t i = 0; i < legs_.size(); ++i) {
    Leg& leg = legs_[i];
    const int motor = motors[i];
    if (anew || encoders[i] != leg.encoder) leg = {encoders[i], motor, motor, -1};
    leg.least = std::min(leg.least, motor);
    leg.most = std::max(leg.most, motor);
    if (leg.pushed_ns < 0 && leg.most - leg.least > much_) leg.pushed_ns = now_ns;
    if (leg.pushed_ns >= 0 && falcon_seconds(leg.pushed_ns, now_ns) > kPatience)
      throw device_error(fmt::format("the encoder of leg {} stays at {} although its motor pushes; {}", i + 1,
                                     leg.encoder, kHomeAgain));
  }
}

}  // namespace haptrace
