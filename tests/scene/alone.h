// One object, touched by itself.
#pragma once

#include "base/json_reader.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "scene/touch.h"

#include <string>

namespace haptrace::test {

/// Returns a scene with one object, as in a file.
inline std::shared_ptr<Scene> scene_with(const std::string& object) {
  return read_scene(parse_json(R"({"objects": [)" + object + "]}", "test"), "test");
}

/// An object that is touched by itself, by a tool that comes from outside.
class Alone {
 public:
  /// `from`: a place outside the object [m].
  explicit Alone(const std::string& object, const Vec3& from = Vec3(0, 0, 1), double rate_hz = 1000)
      : scene_(scene_with(object)), from_(from) {
    scene_->prepare({.rate_hz = rate_hz});
    reset();
  }

  void reset() {
    scene_->reset();
    (void)scene_->answer({.position = from_});
  }

  Contact answer(const Touch& touch) {
    const SceneAnswer answer = scene_->answer(touch);
    return answer.contacts.empty() ? Contact{} : answer.contacts[0];
  }
  [[nodiscard]] const Object& object() const { return scene_->object(0); }
  [[nodiscard]] Scene& scene() { return *scene_; }

 private:
  std::shared_ptr<Scene> scene_;
  Vec3 from_;
};

}  // namespace haptrace::test
