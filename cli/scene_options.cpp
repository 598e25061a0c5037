#include "cli/scene_options.h"

#include "base/error.h"
#include "cli/read_progress.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "scene/slow_scene.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <span>

namespace haptrace::cli {

void TouchArguments::add_to(CLI::App& app) {
  app.add_option("--scene", file, "scene that the hand can touch (docs/scene.md)")
      ->type_name("FILE.json")
      ->group("Scene");
  app.add_option("--scene-rate", rate, "compute a slow scene beside the servo loop, at this rate [Hz] (0: in the loop)")
      ->capture_default_str()
      ->group("Scene");
  app.add_option("--prediction", prediction, "force between two results of a slow scene: hold | linear | model")
      ->group("Scene");
}

std::vector<std::string> TouchArguments::apply(SessionOptions& session, const Output& output) const {
  if (file.empty()) {
    if (rate != 0 || !prediction.empty())
      throw input_error("--scene-rate and --prediction apply to a scene; give a --scene as well");
    return {};
  }
  session.touch.scene = [&] {
    const WaitingLine line(output, "reading " + file);
    return load_scene(file);
  }();
  if (rate == 0) {
    if (!prediction.empty())
      throw input_error(
          "--prediction sets the force between two results of a slow scene; give its --scene-rate as well");
    return {};
  }
  std::vector<std::string> notes;
  const double servo_rate = session.loop.rate_hz;
  const int ticks = SlowScene::ticks_between(rate, servo_rate);
  session.touch.slow.emplace(SlowSceneOptions{.rate_hz = rate});
  if (prediction.empty())
    notes.emplace_back(
        "between two results of the scene, the last force is held (--prediction: hold, linear or model)");
  else
    session.touch.slow->prediction = parse_prediction(prediction);
  if (const double computed = servo_rate / ticks; std::abs(computed - rate) > 1e-6 * computed)
    notes.push_back(
        fmt::format("the scene is computed at {:.4g} Hz, every {} ticks, because a period of {:g} Hz is not a whole "
                    "number of ticks",
                    computed, ticks, rate));
  return notes;
}

std::vector<std::string> notes_on_reach(const SessionOptions& session, const DeviceInfo& info) {
  if (!session.touch.scene) return {};
  const std::vector<std::string> names = session.touch.scene->out_of({info.workspace_min, info.workspace_max});
  if (names.empty()) return {};
  if (names.size() == 1)
    return {fmt::format("'{}' lies outside the workspace of {}: it cannot be touched", names[0], info.name)};
  constexpr std::size_t kMostNames = 4;
  const auto first = std::span(names).first(std::min(names.size(), kMostNames));
  return {fmt::format("{} of {} objects lie outside the workspace of {}: '{}'{} cannot be touched", names.size(),
                      session.touch.scene->size(), info.name, fmt::join(first, "', '"),
                      names.size() > kMostNames ? ", ..." : "")};
}

}  // namespace haptrace::cli
