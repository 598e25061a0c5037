#include "devices/falcon/driver.h"

#include "control/norm.h"
#include "devices/loop/clock.h"

#include <exception>

namespace haptrace {

LastWords falcon_last_words(const FalconCalibration& calibration) {
  constexpr int kPackets = 3;
  LastWords words;
  const auto say = [](std::vector<std::uint8_t>& bytes, const FalconBytes& packet) {
    for (int packets = 0; packets < kPackets; ++packets) bytes.insert(bytes.end(), packet.begin(), packet.end());
  };
  say(words.when_silent, encode({{}, calibration.flags(FalconLights{}, true)}));
  say(words.when_dead, encode({}));
  return words;
}

DeviceInfo falcon_info(const FalconCalibration& calibration) {
  DeviceInfo info;
  info.backend = "falcon";
  info.model = "Novint Falcon";
  info.workspace_min = -calibration.workspace;
  info.workspace_max = calibration.workspace;
  info.max_force = calibration.max_force;
  if (const auto middle = FalconKinematics(calibration.geometry).at_position(calibration.origin)) {
    const Vec3 metres_per_rad = middle->jacobian.colwise().norm().transpose();
    info.position_resolution = metres_per_rad.cwiseQuotient(calibration.counts_per_rad).mean();
  }
  return info;
}

FalconDriver::FalconDriver(std::unique_ptr<FalconLink> link, const FalconCalibration& calibration, DeviceInfo info)
    : calibration_(calibration),
      info_(std::move(info)),
      link_(std::move(link)),
      dialogue_(*link_),
      tracker_(calibration),
      watch_(calibration.max_motor_counts) {
  if (const auto port = link_->guarded_port()) guardian_.emplace(*port, falcon_last_words(calibration));
  DeviceState state;
  state.ready = false;
  for (int rounds = 0; rounds < 2 * FalconTracker::kSettled && !state.ready; ++rounds) (void)round({}, state);
  if (!state.ready)
    info_.notes.emplace_back(
        "the Falcon is not homed: pull its grip all the way out, then push it all the way in, until its logo turns "
        "from red to green. No force acts before that");
}

/// Returns the motor counts for `force`; zero unless the last report was believed.
std::array<std::int16_t, 3> FalconDriver::motors(const Vec3& force) const noexcept {
  if (verdict_ != FalconTracker::Verdict::believed) return {};
  const double magnitude = norm_of(force);
  const double scale = magnitude > calibration_.max_force ? calibration_.max_force / magnitude : 1;
  return calibration_.motors(tracker_.pose()->torques(scale * force));
}

bool FalconDriver::round(const Wrench& wrench, DeviceState& state) {
  if (guardian_) guardian_->beat();
  const auto counts = motors(wrench.force);
  const bool ready = verdict_ != FalconTracker::Verdict::unhomed;
  const FalconLights lights{.red = !ready, .green = ready, .blue = counts != std::array<std::int16_t, 3>{}};
  const std::int64_t sent_ns = monotonic_ns();
  const auto report = dialogue_.ask({counts, calibration_.flags(lights, true)});
  if (!report) return false;

  verdict_ = tracker_.take(*report, sent_ns, monotonic_ns());
  if (verdict_ == FalconTracker::Verdict::doubted) return false;
  state = DeviceState{};
  state.buttons = report->buttons;
  state.ready = verdict_ == FalconTracker::Verdict::believed;
  if (state.ready) {
    watch_.take(report->encoders, counts, sent_ns);
    position_ = tracker_.pose()->position - calibration_.origin;
  } else {
    watch_ = FalconEncoderWatch(calibration_.max_motor_counts);
  }
  state.position = position_;
  return true;
}

ZeroForce FalconDriver::release() noexcept {
  if (link_ == nullptr) return farewell_;
  constexpr int kFarewells = 3;  // several, in case one gets lost
  try {
    for (int farewells = 0; farewells < kFarewells; ++farewells)
      if (dialogue_.ask({})) farewell_ = ZeroForce::confirmed;
  } catch (const std::exception&) {
    // The link fails, but the guardian has its own path to the firmware. An unplugged Falcon still has its power
    // supply, so its motors may hold their force.
  }
  if (guardian_ && farewell_ == ZeroForce::confirmed) guardian_->dismiss();
  // The USB chip may accept these packets, but firmware that does not answer does not confirm them.
  if (guardian_ && farewell_ != ZeroForce::confirmed) (void)guardian_->speak_and_go();
  link_->close();
  link_.reset();
  return farewell_;
}

/// Uses the guardian, because the driver's thread hangs in the link.
ZeroForce FalconDriver::emergency_stop() noexcept {
  return guardian_ && guardian_->speak() ? ZeroForce::sent : ZeroForce::failed;
}

}  // namespace haptrace
