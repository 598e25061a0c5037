// The sessions that the benchmarks time.
#pragma once

#include "control/shapes.h"
#include "devices/servo_loop.h"
#include "player/playback.h"
#include "player/record.h"

#include <memory>
#include <vector>

namespace haptrace::bench {

/// A device that costs nothing, so that what is left is the tick's own cost: it stands where it is.
class Still final : public Device {
 public:
  Still() {
    info_.name = "still";
    info_.virtual_time = true;
    info_.max_force = 8;
    info_.max_continuous_force = 4;
    info_.position_resolution = 5e-5;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench&, double, DeviceState& state) noexcept override {
    state.position = Vec3::Zero();
    state.ready = true;
    return Status::ok;
  }
  void close() noexcept override {}

 private:
  DeviceInfo info_;
};

inline PlaybackController playback(double duration, const PlaybackOptions& options) {
  ForceTerms terms;
  terms.push_back(std::make_unique<PdLaw>());
  const Path path = make_shape("circle", {.size = 0.02, .duration = duration});
  return {Trajectory(path, Interpolation::cubic),
          std::move(terms),
          {.gains = {Vec3::Constant(500), Vec3::Constant(6)}},
          options};
}

}  // namespace haptrace::bench
