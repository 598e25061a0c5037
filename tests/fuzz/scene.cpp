// Fuzz target: a scene. What is read is prepared and touched.
#include "scene/scene.h"

#include "base/json_reader.h"
#include "scene/scene_file.h"
#include "scene/scene_files.h"
#include "tests/fuzz/fuzz.h"

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;  // empty: a scene finds no files
  fuzz::answer([&] {
    SceneFiles files(folder.path());
    const auto scene = read_scene(parse_json(std::string(fuzz::text_of(data, size)), "input"), "input", files);
    for (const Knob& knob : scene->knobs()) {
      fuzz::require(knob.least <= knob.most && !knob.levels.empty());
      scene->set(knob.name, knob.levels.front());
    }
    scene->prepare({});
    scene->reset();
    for (int i = 0; i < 40; ++i) {
      const double t = 0.005 * i - 0.1;
      const SceneAnswer answer = scene->answer(
          {.position = Vec3(t, 0.3 * t, 0.01 * (i % 5)), .velocity = Vec3(5, 1.5, 0), .dt = i > 0 ? 1e-3 : 0});
      fuzz::require(is_finite(answer.force) && std::isfinite(answer.stored));
    }
    (void)scene->notes();
  });
  return 0;
}
