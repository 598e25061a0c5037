// Sessions for the benchmarks.
#pragma once

#include "base/mailbox.h"
#include "control/feedforward.h"
#include "control/iterative_learning.h"
#include "control/observer_pd.h"
#include "control/path/shapes.h"
#include "control/pd.h"
#include "devices/loop/servo_loop.h"
#include "formats/path/path_source.h"
#include "player/playback/playback.h"
#include "player/playback/playback_controller.h"
#include "player/playback/reference_stream.h"
#include "player/record.h"

#include <memory>
#include <vector>

namespace haptrace::bench {

/// A device that stands still and costs no time, so that a benchmark measures the cost of the tick alone.
class Still final : public Device {
 public:
  explicit Still(bool turns = false, const std::array<bool, 3>& axes = {true, true, true}) {
    info_.name = "still";
    info_.virtual_time = true;
    info_.max_force = 8;
    info_.max_continuous_force = 4;
    info_.position_resolution = 5e-5;
    info_.force_axes = axes;
    if (!turns) return;
    info_.torque_axes = {true, true, true};
    info_.max_torque = 0.4;
    info_.measures_orientation = true;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench&, double, DeviceState& state) noexcept override {
    state.position = Vec3::Zero();
    state.orientation = orientation_;
    state.ready = true;
    return Status::ok;
  }
  void close() noexcept override {}

 private:
  DeviceInfo info_;
  Quat orientation_ = info_.measures_orientation ? Quat(Quat::Identity()) : nan_quat();
};

/// Optional parts of a playback, in addition to the PD law.
struct Made {
  bool observer = false, gravity = false, friction = false, inertia = false, learned = false, guard = false;
  bool orientation = false, tuning = false;
  Interpolation interpolation = Interpolation::cubic;

  static Made every_compensation() {
    return {.observer = true, .gravity = true, .friction = true, .inertia = true, .learned = true, .guard = true};
  }
};

inline PlaybackController playback(double duration, const PlaybackOptions& options, const Made& made = {}) {
  static const ForceTable table{.step = 0.004, .force = std::vector<Vec3>(1000, Vec3(0.1, 0.2, 0.3))};
  PlantModel plant;
  plant.mass = Vec3::Constant(0.4);
  plant.viscous = Vec3::Constant(1.8);
  plant.coulomb = Vec3::Constant(0.7);
  plant.delay = 1.5e-3;
  plant.position_resolution = 5e-5;
  const TrackingDesign design = design_tracking(plant, {.max_force = 8});
  ForceTerms terms;
  if (made.gravity) terms.push_back(std::make_unique<GravityFeedforward>(plant));
  if (made.friction) terms.push_back(std::make_unique<FrictionFeedforward>(plant));
  if (made.learned) {
    auto learned = std::make_unique<LearnedForce>(duration, 0);
    learned->use(&table);
    terms.push_back(std::move(learned));
  }
  if (made.observer)
    terms.push_back(std::make_unique<ObserverPd>(ObserverPd::Options{.design = design, .position_resolution = 5e-5}));
  else
    terms.push_back(std::make_unique<PdLaw>());
  if (made.inertia) terms.push_back(std::make_unique<InertiaFeedforward>(design.mass));
  Path path = make_shape("circle", {.size = 0.02, .duration = duration});
  if (made.orientation) path.orientation.assign(path.size(), Quat::Identity());
  const std::uint64_t rows = path.size();
  const TrajectoryPieces pieces(source_of(std::move(path)), made.interpolation,
                                {.undivided = rows, .smoothing = 0, .orientation = made.orientation});
  const Tuning tuning{.gains = {Vec3::Constant(500), Vec3::Constant(6)}};
  static Mailbox<Tuning> changes(tuning);
  PlaybackController controller(ReferenceStream(pieces, {}), std::move(terms), tuning, options,
                                made.tuning ? &changes : nullptr);
  if (made.orientation) controller.turn({});
  if (made.guard) controller.guard({});
  return controller;
}

}  // namespace haptrace::bench
