#include "scene/scene.h"

#include "base/error.h"
#include "cli/read_progress.h"
#include "cli/verb.h"
#include "plot/shaded.h"
#include "scene/scene_file.h"
#include "studies/scene_report.h"

#include <filesystem>
#include <fmt/format.h>

namespace haptrace::cli {
namespace {

struct SceneArguments {
  std::string file, picture;
  double rate = 1000;
  bool overwrite = false;
};

/// Largest distance of a picture's triangles from the surface, as a share of the scene.
constexpr double kPictureTolerance = 5e-4;

std::vector<ShadedObject> drawn(const Scene& scene) {
  const Box space = space_of(scene);
  std::vector<ShadedObject> objects;
  for (std::size_t i = 0; i < scene.size(); ++i)
    objects.push_back(
        {scene.object(i).tessellated(kPictureTolerance * space.size().norm(), space), static_cast<int>(i)});
  return objects;
}

}  // namespace

Verb add_scene(CLI::App& app) {
  const auto arguments = std::make_shared<SceneArguments>();
  CLI::App* verb = app.add_subcommand("scene", "check a scene, print what it contains and costs, and draw it");
  verb->footer(
      "  haptrace scene samples/scenes/sphere_on_wall.json -o scene.png\n"
      "record --scene lets a hand touch it; docs/scene.md describes the file.");
  verb->add_option("file", arguments->file, "scene (JSON)")->type_name("FILE.json");
  verb->add_option("-o,--output", arguments->picture, "draw the scene into this file")->type_name("FILE.png");
  verb->add_flag("--overwrite", arguments->overwrite, "replace the picture");
  verb->add_option("--rate", arguments->rate, "rate of the servo loop [Hz]")->capture_default_str();
  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            const std::shared_ptr<Scene> scene = [&] {
              const WaitingLine line(output, "reading " + arguments->file);
              return load_scene(arguments->file);
            }();
            const SceneReport report = [&] {
              const WaitingLine line(output, "measuring the time of a tick");
              return report_scene(*scene, arguments->rate);
            }();
            if (!arguments->picture.empty()) {
              const WaitingLine line(output, "drawing " + arguments->picture);
              draw_shaded(drawn(*scene), std::filesystem::path(arguments->file).filename().string(), arguments->picture,
                          arguments->overwrite);
            }
            nlohmann::json json = to_json(report);
            json["file"] = arguments->file;
            if (!arguments->picture.empty()) json["picture"] = arguments->picture;
            output.tell(json, fmt::format("{}: valid\n{}{}", arguments->file, text_of(report),
                                          arguments->picture.empty() ? "" : arguments->picture + "\n"));
            return kDone;
          }};
}

}  // namespace haptrace::cli
