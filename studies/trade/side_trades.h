// Trade-offs outside the playback loop: recordings, projection onto a path and simulation.
#pragma once

#include "formats/recording/storage.h"
#include "studies/trade/workbench.h"

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Levels of a setting with measurements of its own kind.
struct SideTrade {
  struct Column {
    const char* key;   ///< key in JSON, with its SI unit
    const char* head;  ///< heading in the text report
    double scale;      ///< display unit in SI
    int digits;        ///< number of decimals
  };
  struct Level {
    std::string level;
    bool is_default = false;
    std::vector<double> values;  ///< one for each column, SI; NaN: not measured
    std::string refused;         ///< why the level is not possible; empty if it is
  };

  std::string knob;
  std::string what;  ///< one line of description
  std::vector<Column> columns;
  std::vector<Level> levels;
};

/// A named way to store a recording. storage_levels() lists the ones with the least CPU time first.
struct StorageLevel {
  std::string name;
  Storage storage;
};
const std::vector<StorageLevel>& storage_levels();

inline constexpr std::string_view kStorageKnob = "storage";

/// Measures stored precision and compression: size, largest storage error, and CPU time per sample.
SideTrade trade_of_storage(const Workbench& bench, const Configuration& configuration, const StopRequest& stop);

/// Measures the spacing of the path in guidance: the errors of the trainee's place and of the expert's force there,
/// relative to the finest path. The trainee wanders around the path by 2 mm at a third to three times its speed.
SideTrade trade_of_projection(const Workbench& bench, bool instructions, const StopRequest& stop);

/// Measures integrator and longest step of the simulated device while it plays the configuration: the differences of
/// the tool's true trajectory and of the session's metrics to those of the finest simulation, and the cost of a
/// simulated millisecond. Friction and encoder counts make two trajectories with a negligible initial difference
/// diverge by a fraction of a count. Below that, only the metrics judge a step, not its trajectory. `open` makes the
/// device with further options of `sim`. There are no levels unless the device is a `sim` device.
SideTrade trade_of_simulation(
    const Workbench& bench, const Configuration& configuration,
    const std::function<std::unique_ptr<Device>(const std::vector<std::pair<std::string, std::string>>&)>& open,
    const StopRequest& stop);

nlohmann::json to_json(const SideTrade& trade);
std::string text_of(const SideTrade& trade);

}  // namespace haptrace
