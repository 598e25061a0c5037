// The trade of a scene: what its accuracy settings cost, and the settings that keep a budget.
#pragma once

#include "scene/scene.h"
#include "studies/trade/side_trades.h"

#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Upper bounds on a scene's force error and cost. NaN: none.
struct SceneBudget {
  double error = kNaN;  ///< rms, during contact [N]
  double peak = kNaN;   ///< largest, during contact [N]
  double time = kNaN;   ///< mean time of an answer on this machine [s]

  [[nodiscard]] bool empty() const noexcept { return std::isnan(error) && std::isnan(peak) && std::isnan(time); }
};

/// Reads "error<=20mN, peak<=0.1N, time<=500ns". Throws Error(input) that names the part.
SceneBudget parse_scene_budget(std::string_view text);
std::string to_string(const SceneBudget& budget);

/// Levels of all accuracy settings, with what was measured.
struct SceneChoice {
  std::map<std::string, double> levels;  ///< by setting, as "object.setting"
  double error = kNaN, peak = kNaN;      ///< [N]
  double time = kNaN;                    ///< [s]
  double instructions = kNaN;            ///< of an answer during contact
  bool kept = false;                     ///< keeps the budget; else it is the nearest
};

/// Measures a scene while the tool follows the path of a workbench. The error is the difference between the force that
/// is held over a tick and the force of the continuous scene, with every setting at its most accurate level, in the
/// middle of the tick, during contact.
class SceneBench {
 public:
  /// `load` makes the scene as it is described; calls it once for each measurement. Throws what it throws.
  SceneBench(const Workbench& bench, double rate_hz, std::function<std::shared_ptr<Scene>()> load, bool instructions);

  /// Returns false if the path touches nothing. Then there is nothing to measure.
  [[nodiscard]] bool touches() const noexcept { return first_touch_ < touches_.size(); }

  /// Measures every setting by itself, and the scene at a tenth and a twentieth of the rate with each prediction, with
  /// the energy created. There are no levels if the path touches nothing.
  [[nodiscard]] SideTrade trade() const;

  /// Returns the cheapest settings that keep the budget, or the most accurate if it bounds the time only, or the
  /// nearest if none keeps it. Tries all combinations where these are few; otherwise varies one setting after another.
  /// Stops early on `stop`. Requires touches().
  [[nodiscard]] SceneChoice choose(const SceneBudget& budget, const StopRequest& stop) const;

 private:
  struct Measured {
    double error, peak, created, time, instructions;
  };
  using Levels = std::map<std::string, double>;
  [[nodiscard]] Measured measure(Touchable& scene, bool instructions) const;
  [[nodiscard]] SceneChoice tried(const Levels& levels, const SceneBudget& budget) const;

  double rate_hz_;
  std::function<std::shared_ptr<Scene>()> load_;
  bool instructions_;
  std::vector<Touch> touches_;
  std::vector<Vec3> truth_;
  std::vector<bool> touched_;
  std::size_t first_touch_ = 0;
  mutable std::map<Levels, Measured> known_;  ///< what choose() has measured
};

/// Returns the scene file's JSON with these levels. Files that lie in `folder` are named by their whole path, so that
/// the result can be stored elsewhere. Throws Error(input) if a setting has no place in the file.
nlohmann::json scene_with(const nlohmann::json& scene, const std::string& folder,
                          const std::map<std::string, double>& levels);

nlohmann::json to_json(const SceneChoice& choice);
std::string text_of(const SceneChoice& choice, const SceneBudget& budget);

}  // namespace haptrace
