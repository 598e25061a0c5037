// Which gains a plant bears: by passivity, by linear analysis, and in simulation.
#pragma once

#include "control/design/loop_analysis.h"
#include "control/tuning.h"
#include "devices/loop/servo_loop.h"
#include "plot/figure.h"

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

struct StabilityOptions {
  double rate_hz = 1000;
  std::string velocity = "lowpass:100";  ///< see make_velocity_estimator
  double lag = 0;                        ///< the part of the plant's delay that is the motor's first-order lag [s]
  std::optional<ObserverModel> observer;
  std::optional<int> axis;  ///< 0 to 2; else the one whose modulus margin at the present gains is the least
  MarginFloor floor;        ///< for the suggested gains
  std::size_t kp_cells = 24, kd_cells = 24;  ///< 2 to 400
  double kick = 1e-3;       ///< by which the reference jumps in simulations with friction and quantum [m]
  std::size_t threads = 0;  ///< 0: one for every core. The map does not depend on it
};

/// What is known of one pair of gains.
struct StabilityCell {
  bool passive = false;          ///< LoopAnalysis::passive
  bool stable = false;           ///< LoopAnalysis::stable
  bool simulated = false;        ///< stable in a simulation without friction and quantum, so comparable with `stable`
  bool simulated_fully = false;  ///< calm in a simulation with them
};

/// The largest kp of each kind with a kd [N/m]. 0: none in the map, or for `stable` none at all; NaN: above the map.
struct StabilityBoundary {
  double passive = 0;
  double stable = 0;
  double simulated = 0;
  double simulated_fully = 0;
};

/// One axis of a plant over a grid of gains. Cells of one kd are adjacent: cells[kd * kp.size() + kp].
struct StabilityMap {
  int axis = 0;  ///< of W
  LoopModel loop;
  double coulomb = 0;          ///< [N]
  std::vector<double> kp, kd;  ///< ascending, even on a logarithmic scale [N/m], [N s/m]
  std::vector<StabilityCell> cells;
  std::vector<StabilityBoundary> boundaries;  ///< one for each kd, to a third of a per cent
  AxisGains present;
  StabilityCell at_present;
  Margins margins;      ///< of the present gains
  AxisGains suggested;  ///< as stiff as the floor allows; zeros when nothing keeps it
  MarginFloor floor;
};

/// Maps `plant` under `gains`. The grid reaches from a third of a per cent of the largest stable kd, and a thousandth
/// of the largest stable kp, to beyond both, and holds the present gains.
///
/// Simulations are of SimDevice with a servo loop's order of things. Without friction and quantum a push of one tick
/// sets the mass moving, and the energy 0.5 m v^2 + 0.5 kp x^2 grows or does not: compared over windows of two natural
/// periods. With them (noise left out) the reference jumps by `kick`; that is calm when the position swings by less
/// than two quanta or a twentieth of the kick in the end, or ever less.
///
/// `progress` is called in the calling thread about ten times a second with the part that is done. Nothing when
/// `stop` was raised meanwhile. Throws Error(input): gains, axis or cells out of range, and what LoopAnalysis throws.
std::optional<StabilityMap> stability_map(const PlantModel& plant, const PdGains& gains,
                                          const StabilityOptions& options, const StopRequest& stop,
                                          const std::function<void(double)>& progress = {});

/// What stability_map does at each pair of gains, for three at once; `fully` with friction and quantum.
/// `options` as there; of `plant`, `axis` counts.
std::array<bool, 3> simulate_stability(const PlantModel& plant, int axis, const std::array<AxisGains, 3>& gains,
                                       const StabilityOptions& options, bool fully);

nlohmann::json to_json(const Margins& margins);
nlohmann::json to_json(const StabilityMap& map);

/// The boundaries as lines over kd, and the present and suggested gains: the whole map, and the part round the present
/// gains.
Figure figure_of(const StabilityMap& map);

}  // namespace haptrace
