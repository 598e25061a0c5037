#include "scene/scene.h"

#include "base/error.h"
#include "base/suggest.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {

Scene::Scene(std::vector<std::unique_ptr<SceneObject>> objects, bool passivity)
    : objects_(std::move(objects)), contacts_(objects_.size()), passivity_(passivity) {
  if (objects_.empty()) throw input_error("the scene has no objects; add at least one");
  std::vector<std::string> sorted = names();
  std::sort(sorted.begin(), sorted.end());
  const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
  if (twice != sorted.end())
    throw input_error(fmt::format("two objects are called '{}'; give each a 'name' of its own", *twice));
}

void Scene::prepare(const SceneTiming& timing) {
  check_range("the rate of the scene", timing.rate_hz, 0.1, 1e6, "Hz");
  for (const auto& object : objects_) object->prepare(timing);
}

void Scene::reset() noexcept {
  for (const auto& object : objects_) object->reset();
}

SceneAnswer Scene::answer(const Touch& touch) noexcept {
  SceneAnswer sum{.contacts = contacts_};
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    contacts_[i] = objects_[i]->answer(touch);
    sum.force += contacts_[i].force;
    sum.stored += contacts_[i].stored;
  }
  return sum;
}

std::vector<std::string> Scene::names() const {
  std::vector<std::string> names;
  for (const auto& object : objects_) names.push_back(object->name());
  return names;
}

std::vector<std::string> Scene::out_of(const Box& workspace) const {
  std::vector<std::string> names;
  for (const auto& object : objects_)
    if (!object->meets(workspace)) names.push_back(object->name());
  return names;
}

std::vector<Knob> Scene::knobs() const {
  std::vector<Knob> knobs;
  for (const auto& object : objects_)
    for (Knob knob : object->knobs()) {
      knob.name = object->name() + "." + knob.name;
      knobs.push_back(std::move(knob));
    }
  return knobs;
}

void Scene::set(const std::string& knob, double level) {
  const std::size_t dot = knob.rfind('.');
  for (const auto& object : objects_)
    if (dot != std::string::npos && knob.compare(0, dot, object->name()) == 0)
      return object->set(knob.substr(dot + 1), level);
  std::vector<std::string> known;
  for (const Knob& own : knobs()) known.push_back(own.name);
  throw input_error(fmt::format("the scene has no accuracy setting '{}'{}", knob, suggestion(knob, known)));
}

}  // namespace haptrace
