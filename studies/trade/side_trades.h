// What is traded beside a playback's loop: recordings, the place on a path, the simulation.
#pragma once

#include "formats/recording/storage.h"
#include "scene/scene.h"
#include "studies/trade/workbench.h"

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Levels of a knob with figures of its own kind.
struct SideTrade {
  struct Column {
    const char* key;   ///< in JSON, with its SI unit
    const char* head;  ///< for people
    double scale;      ///< of what people are told, in SI
    int digits;        ///< after the point
  };
  struct Level {
    std::string level;
    bool is_default = false;
    std::vector<double> values;  ///< one for each column, SI; NaN: not measured
    std::string refused;         ///< why it cannot be had; empty when it can
  };

  std::string knob;
  std::string what;  ///< one line for people
  std::vector<Column> columns;
  std::vector<Level> levels;
};

/// Ways to store a recording, the cheapest in time first, and how they are called.
struct StorageLevel {
  std::string name;
  Storage storage;
};
const std::vector<StorageLevel>& storage_levels();

inline constexpr std::string_view kStorageKnob = "storage";

/// Stored precision and compression: size, the largest error that storing makes, CPU time of a row.
SideTrade trade_of_storage(const Workbench& bench, const Configuration& configuration, const StopRequest& stop);

/// The spacing of the path that guidance follows: how far the place of a trainee is off, who wanders round the path by
/// 2 mm at a third to three times its speed, and by how much the expert's force there, from those on the finest path.
SideTrade trade_of_projection(const Workbench& bench, bool instructions, const StopRequest& stop);

/// Integrator and longest step of the simulated device, with the configuration played on it: how far the tool's true
/// way and the session's figures are from those of the finest, and what simulating a millisecond costs. Friction and
/// counts make two ways that began to differ by nothing part by a fraction of a count: below that a step says nothing
/// by its way, only by the figures. `open` makes the device with further options of `sim`. No levels unless the device
/// is one of `sim`.
SideTrade trade_of_simulation(
    const Workbench& bench, const Configuration& configuration,
    const std::function<std::unique_ptr<Device>(const std::vector<std::pair<std::string, std::string>>&)>& open,
    const StopRequest& stop);

/// Every knob of a scene's objects, and a scene that is served at a tenth and a twentieth of the rate with each
/// prediction, while the tool goes along the path: how far the force that is held over a tick is from that of the
/// continuous scene in the middle of the tick, where something is touched, and the energy that is created. No levels
/// when the path touches nothing. `load` makes the scene as it was described. Throws what it throws.
SideTrade trade_of_scene(const Workbench& bench, double rate_hz, const std::function<std::shared_ptr<Scene>()>& load,
                         bool instructions);

nlohmann::json to_json(const SideTrade& trade);
std::string text_of(const SideTrade& trade);

}  // namespace haptrace
