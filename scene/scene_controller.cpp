#include "scene/scene_controller.h"

#include "control/norm.h"

#include <algorithm>

namespace haptrace {

SceneController::SceneController(std::shared_ptr<Touchable> touchable, std::vector<std::string> names,
                                 const std::optional<PassivityLayer::Options>& passivity)
    : touchable_(std::move(touchable)), episodes_(names.size()) {
  if (passivity) layer_.emplace(*passivity);
  for (std::string& name : names) figures_.push_back({.name = std::move(name)});
}

void SceneController::start(const State&) noexcept {
  touchable_->reset();
  // A contact from before a gap gets no `left` event, because its end is not known.
  std::fill(episodes_.begin(), episodes_.end(), Episode{});
  if (layer_) layer_->reset();
}

Command SceneController::update(const State& state) noexcept {
  const SceneAnswer answer =
      touchable_->answer({.position = state.position, .velocity = state.velocity, .dt = state.dt});
  for (std::size_t i = 0; i < episodes_.size(); ++i) follow(i, answer.contacts[i], state.dt);
  Command command;
  command.wrench.force = answer.force;
  if (layer_) command.wrench.force += layer_->update(state, answer.stored);
  command.event = tell();
  return command;
}

void SceneController::follow(std::size_t object, const Contact& contact, double dt) noexcept {
  Episode& episode = episodes_[object];
  TouchFigures& figures = figures_[object];
  if (!contact.touched()) {
    episode.since += dt;
    return;
  }
  episode.begun = true;
  episode.since = 0;
  episode.force = norm_of(contact.force);
  episode.depth = std::max(episode.depth, contact.depth);
  episode.seconds += dt;
  figures.seconds += dt;
  figures.max_force = std::max(figures.max_force, episode.force);
  figures.max_depth = std::max(figures.max_depth, contact.depth);
}

/// Reports one event per tick; further events wait for the next ticks.
std::optional<Event> SceneController::tell() noexcept {
  for (std::size_t i = 0; i < episodes_.size(); ++i) {
    Episode& episode = episodes_[i];
    const auto index = static_cast<double>(i);
    if (episode.begun && !episode.told) {
      episode.told = true;
      ++figures_[i].times;
      return Event{.code = EventCode::touched, .values = {index, episode.force, kNaN}};
    }
    if (episode.told && episode.since >= kLeft) {
      const Event event{.code = EventCode::left, .values = {index, episode.depth, episode.seconds}};
      episode = {};
      return event;
    }
  }
  return std::nullopt;
}

std::unique_ptr<SceneController> make_scene_controller(const std::shared_ptr<Scene>& scene, double rate_hz,
                                                       const std::optional<SlowSceneOptions>& slow,
                                                       const std::optional<PassivityLayer::Options>& passivity) {
  std::shared_ptr<Touchable> touchable = scene;
  if (slow)
    touchable = std::make_shared<SlowScene>(scene, *slow, rate_hz);
  else
    scene->prepare({.rate_hz = rate_hz});
  return std::make_unique<SceneController>(std::move(touchable), scene->names(), passivity);
}

}  // namespace haptrace
