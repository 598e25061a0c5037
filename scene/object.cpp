#include "scene/object.h"

#include "base/suggest.h"

#include <fmt/format.h>

namespace haptrace {

Error unknown_knob(const SceneObject& object, const std::string& knob) {
  std::vector<std::string> known;
  for (const Knob& own : object.knobs()) known.push_back(own.name);
  return input_error(
      fmt::format("{}: the accuracy setting '{}' is not known{}", object.name(), knob, suggestion(knob, known)));
}

}  // namespace haptrace
