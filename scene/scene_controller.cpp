#include "scene/scene_controller.h"

#include "control/norm.h"
#include "scene/slow_scene.h"

#include <algorithm>
#include <utility>

namespace haptrace {

SceneController::SceneController(std::shared_ptr<Touchable> touchable, std::vector<std::string> names,
                                 const std::optional<PassivityLayer::Options>& passivity)
    : touchable_(std::move(touchable)), episodes_(names.size()) {
  if (passivity) layer_.emplace(*passivity);
  for (std::string& name : names) figures_.push_back({.name = std::move(name)});
  open_.reserve(figures_.size());
  contacts_.resize(figures_.size());
}

void SceneController::start(const State&) noexcept {
  touchable_->reset();
  // A contact from before a gap gets no `left` event, because its end is not known.
  std::fill(episodes_.begin(), episodes_.end(), Episode{});
  open_.clear();
  if (layer_) layer_->reset();
}

Command SceneController::update(const State& state) noexcept {
  Command command = touch(state);
  command.event = take_event();
  return command;
}

Command SceneController::touch(const State& state) noexcept {
  const SceneAnswer answer =
      touchable_->answer({.position = state.position, .velocity = state.velocity, .dt = state.dt});
  for (const std::size_t open : open_) episodes_[open].since += state.dt;
  Command command;
  command.wrench.force = answer.force;
  std::size_t count = 0;
  for (const Contact& contact : answer.contacts) {
    // A tool in a valley of a texture is about to meet its crests.
    command.vibration += contact.vibration;
    if (!contact.acts() && contact.force.isZero(0)) continue;
    follow(contact, state.dt);
    contacts_[count++] = {.object = contact.object,
                          .proxy = contact.proxy,
                          .normal = contact.normal,
                          .depth = contact.depth,
                          .force = contact.force};
  }
  command.contacts = {contacts_.data(), count};
  if (layer_) command.wrench.force += layer_->update(state, answer.stored);
  return command;
}

void SceneController::follow(const Contact& contact, double dt) noexcept {
  Episode& episode = episodes_[contact.object];
  TouchFigures& figures = figures_[contact.object];
  if (!episode.begun) {
    open_.push_back(contact.object);
    episode.inside = contact.pushed_out;
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

std::optional<Event> SceneController::take_event() noexcept {
  for (auto open = open_.begin(); open != open_.end(); ++open) {
    Episode& episode = episodes_[*open];
    const auto index = static_cast<double>(*open);
    if (std::exchange(episode.inside, false))
      return Event{.code = EventCode::began_inside, .values = {index, episode.depth, kNaN}};
    if (!episode.told) {
      episode.told = true;
      ++figures_[*open].times;
      return Event{.code = EventCode::touched, .values = {index, episode.force, kNaN}};
    }
    if (episode.since >= TouchFigures::kLeft) {
      const Event event{.code = EventCode::left, .values = {index, episode.depth, episode.seconds}};
      episode = {};
      open_.erase(open);
      return event;
    }
  }
  return std::nullopt;
}

std::unique_ptr<SceneController> make_scene_controller(const std::shared_ptr<Scene>& scene, double rate_hz,
                                                       const std::optional<SlowSceneOptions>& slow,
                                                       const std::optional<PassivityLayer::Options>& passivity,
                                                       double resolution) {
  std::shared_ptr<Touchable> touchable = scene;
  if (slow)
    touchable = std::make_shared<SlowScene>(scene, *slow, rate_hz, resolution);
  else
    scene->prepare({.rate_hz = rate_hz, .resolution = resolution});
  return std::make_unique<SceneController>(std::move(touchable), scene->names(), passivity);
}

}  // namespace haptrace
