#include "scene/scene.h"

#include "base/error.h"
#include "base/suggest.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {

Scene::Scene(std::vector<std::unique_ptr<Object>> objects, const SceneOptions& options)
    : objects_(std::move(objects)), options_(options), contacts_(objects_.size()) {
  if (objects_.empty()) throw input_error("the scene has no objects; add at least one");
  std::vector<std::string> sorted = names();
  std::sort(sorted.begin(), sorted.end());
  const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
  if (twice != sorted.end())
    throw input_error(fmt::format("two objects are called '{}'; give each a 'name' of its own", *twice));
  held_.reserve(objects_.size());
}

void Scene::prepare(const SceneTiming& timing) {
  check_range("the rate of the scene", timing.rate_hz, 0.1, 1e6, "Hz");
  std::vector<Box> boxes;
  ahead_ = 0;
  for (const auto& object : objects_) {
    object->prepare(timing, options_.tool);
    ahead_ = std::max(ahead_, object->surface().ahead());
    Box box = object->bounds();
    box.min -= Vec3::Constant(timing.ahead);
    box.max += Vec3::Constant(timing.ahead);
    boxes.push_back(box);
  }
  near_ = BroadPhase(std::move(boxes));
  reset();
}

void Scene::reset() noexcept {
  for (const auto& object : objects_) object->reset();
  held_.clear();
  last_position_ = last_velocity_ = nan3();
}

/// Returns the box around the places of the tool in this query and the last.
Box Scene::swept(const Touch& touch) const noexcept {
  Box box{touch.position, touch.position};
  if (ahead_ > 0) box.include(touch.position + ahead_ * touch.velocity);
  if (std::isnan(touch.last_position.x())) return box;
  box.include(touch.last_position);
  if (ahead_ > 0) box.include(touch.last_position + ahead_ * touch.last_velocity);
  return box;
}

void Scene::ask(std::uint32_t object, const Touch& touch, SceneAnswer& sum) noexcept {
  Contact contact = objects_[object]->answer(touch);
  contact.object = object;
  sum.force += contact.force;
  sum.stored += contact.stored;
  contacts_.add(contact);
}

SceneAnswer Scene::answer(const Touch& touch) noexcept {
  SceneAnswer sum;
  contacts_.clear();
  if (!touch.valid()) return sum;
  Touch now = touch;
  now.last_position = last_position_;
  now.last_velocity = last_velocity_;
  last_position_ = touch.position;
  last_velocity_ = touch.velocity;
  if (objects_.size() == 1) {
    ask(0, now, sum);
  } else {
    const std::span<const std::uint32_t> asked = near_.near(swept(now), held_);
    held_.clear();
    for (const std::uint32_t object : asked) {
      ask(object, now, sum);
      if (objects_[object]->holds()) held_.push_back(object);
    }
  }
  sum.contacts = contacts_.all();
  return sum;
}

std::vector<std::string> Scene::names() const {
  std::vector<std::string> names;
  for (const auto& object : objects_) names.push_back(object->name());
  return names;
}

std::vector<std::string> Scene::notes() const {
  std::vector<std::string> notes;
  for (const auto& object : objects_) {
    for (const std::string& note : object->remarks()) notes.push_back(object->name() + ": " + note);
  }
  return notes;
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
