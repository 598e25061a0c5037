// A scene as a controller: the hand touches what is there.
#pragma once

#include "control/controller.h"
#include "control/passivity_layer.h"
#include "scene/scene.h"
#include "scene/slow_scene.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// What a hand felt of one object.
struct TouchFigures {
  std::string name;      ///< of the object
  int times = 0;         ///< that it was touched; a gap of less than SceneController::kLeft is none
  double seconds = 0;    ///< in which it was
  double max_force = 0;  ///< magnitude, as the object answered it, before limits and fades [N]
  double max_depth = 0;  ///< [m]
};

/// Sends the force of what is touched, and tells the events `touched` and `left`.
///
/// With a passivity layer, it adds the force that takes back the energy that sampling created in the contacts.
class SceneController final : public Controller {
 public:
  static constexpr double kLeft = 0.02;  ///< without contact, after which an object is left [s]

  /// `names` of the objects, as many as `touchable` answers contacts.
  SceneController(std::shared_ptr<Touchable> touchable, std::vector<std::string> names,
                  const std::optional<PassivityLayer::Options>& passivity = std::nullopt);

  void start(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override { touchable_->between_ticks(may_wait); }

  /// Since the construction. Not for the tick.
  [[nodiscard]] std::vector<TouchFigures> figures() const { return figures_; }
  [[nodiscard]] std::vector<std::string> remarks() const { return touchable_->remarks(); }
  /// The passivity layer, or null without one.
  [[nodiscard]] const PassivityLayer* layer() const noexcept { return layer_ ? &*layer_ : nullptr; }

 private:
  /// The contact with one object.
  struct Episode {
    bool begun = false, told = false;  ///< told: that it began
    double force = 0;                  ///< newest, magnitude [N]
    double depth = 0;                  ///< the largest [m]
    double seconds = 0, since = 0;     ///< touched, and not touched since [s]
  };
  void follow(std::size_t object, const Contact& contact, double dt) noexcept;
  std::optional<Event> tell() noexcept;

  std::shared_ptr<Touchable> touchable_;
  std::vector<TouchFigures> figures_;
  std::vector<Episode> episodes_;
  std::optional<PassivityLayer> layer_;
};

/// The controller that lets a hand touch `scene`, which it prepares: for this servo rate or, when `slow` says so, for a
/// rate of its own. With `passivity` a layer supervises it, whatever the scene says. Throws as Scene::prepare,
/// SlowScene and PassivityLayer do.
std::unique_ptr<SceneController> make_scene_controller(
    const std::shared_ptr<Scene>& scene, double rate_hz, const std::optional<SlowSceneOptions>& slow = std::nullopt,
    const std::optional<PassivityLayer::Options>& passivity = std::nullopt);

}  // namespace haptrace
