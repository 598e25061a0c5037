// Map of the gains at which a plant is passive, stable by linear analysis, and stable in simulation.
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
  double lag = 0;                        ///< the motor's first-order lag, as a part of the plant's delay [s]
  std::optional<ObserverModel> observer;
  std::optional<int> axis;  ///< 0 to 2; absent: the axis with the smallest modulus margin at the present gains
  MarginFloor floor;        ///< margins that the suggested gains must keep
  std::size_t kp_cells = 24, kd_cells = 24;  ///< 2 to 400
  double kick = 1e-3;       ///< step of the reference in simulations with friction and position resolution [m]
  std::size_t threads = 0;  ///< 0: one for every core. The map does not depend on it
};

/// Results for one pair of gains.
struct StabilityCell {
  bool passive = false;          ///< LoopAnalysis::passive
  bool stable = false;           ///< LoopAnalysis::stable
  bool simulated = false;        ///< stable in a simulation without friction and encoder steps, like `stable`
  bool simulated_fully = false;  ///< calm in a simulation with friction and position resolution
};

/// Largest kp of each kind at one kd [N/m]. 0: none in the map, or for `stable` none at all; NaN: above the map.
struct StabilityBoundary {
  double passive = 0;
  double stable = 0;
  double simulated = 0;
  double simulated_fully = 0;
};

/// One axis of a plant over a grid of gains. Cells of one kd are adjacent: cells[kd * kp.size() + kp].
struct StabilityMap {
  int axis = 0;  ///< axis of W
  LoopModel loop;
  double coulomb = 0;          ///< [N]
  std::vector<double> kp, kd;  ///< ascending, uniform on a logarithmic scale [N/m], [N s/m]
  std::vector<StabilityCell> cells;
  std::vector<StabilityBoundary> boundaries;  ///< one for each kd, accurate to a third of a per cent
  AxisGains present;
  StabilityCell at_present;
  Margins margins;      ///< margins of the present gains
  AxisGains suggested;  ///< stiffest gains that keep the floor; zero if there are none
  MarginFloor floor;
};

/// Computes the map of `plant` around `gains`. The grid reaches from a third of a per cent of the largest stable kd,
/// and a thousandth of the largest stable kp, to beyond both, and contains the present gains.
///
/// The simulations use SimDevice and the order of operations of the servo loop. Without friction and position
/// resolution, a push of one tick sets the mass moving. The loop is unstable if the energy 0.5 m v^2 + 0.5 kp x^2 grows
/// over windows of two natural periods. With friction and position resolution (noise left out), the reference jumps by
/// `kick`. The loop is calm if the position finally swings by less than two resolutions or a twentieth of the kick, or
/// if the swing keeps shrinking.
///
/// Calls `progress` in the calling thread about ten times a second with the finished share. Returns no map if `stop`
/// was raised meanwhile. Throws Error(input) when gains, axis or cells are out of range, and what LoopAnalysis throws.
std::optional<StabilityMap> stability_map(const PlantModel& plant, const PdGains& gains,
                                          const StabilityOptions& options, const StopRequest& stop,
                                          const std::function<void(double)>& progress = {});

/// Simulates three pairs of gains at once like stability_map; `fully` with friction and position resolution. Only
/// `axis` of `plant` counts. Returns which pairs are stable or, with `fully`, calm.
std::array<bool, 3> simulate_stability(const PlantModel& plant, int axis, const std::array<AxisGains, 3>& gains,
                                       const StabilityOptions& options, bool fully);

nlohmann::json to_json(const Margins& margins);
nlohmann::json to_json(const StabilityMap& map);

/// Returns a plot of the boundaries over kd with the present and suggested gains: the whole map, and the part around
/// the present gains.
Figure figure_of(const StabilityMap& map);

}  // namespace haptrace
