// A controller that sends the contact forces of a scene.
#pragma once

#include "control/controller.h"
#include "control/passivity_layer.h"
#include "scene/scene.h"
#include "scene/scene_session.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Sends the contact force and reports the events `touched` and `left`, and `began_inside` where the tool was inside an
/// object at the start.
///
/// With a passivity layer, it adds the force that takes back the energy that sampling created in the contacts.
class SceneController final : public Controller {
 public:
  /// `names` of the objects, as many as `touchable` answers contacts.
  SceneController(std::shared_ptr<Touchable> touchable, std::vector<std::string> names,
                  const std::optional<PassivityLayer::Options>& passivity = std::nullopt);

  void start(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;
  /// Returns the answer without an event, which waits for take_event().
  [[nodiscard]] Command touch(const State& state) noexcept;
  /// Returns the next event to report, if any; one per call.
  [[nodiscard]] std::optional<Event> take_event() noexcept;
  void between_ticks(bool may_wait) noexcept override { touchable_->between_ticks(may_wait); }

  /// Returns the statistics since the construction. Not real-time.
  [[nodiscard]] std::vector<TouchFigures> figures() const { return figures_; }
  [[nodiscard]] std::vector<std::string> remarks() const { return touchable_->remarks(); }
  /// The passivity layer, or null without one.
  [[nodiscard]] const PassivityLayer* layer() const noexcept { return layer_ ? &*layer_ : nullptr; }

 private:
  /// The current contact with one object.
  struct Episode {
    bool begun = false, told = false;  ///< told: the `touched` event was reported
    bool inside = false;               ///< the tool began inside, which is not yet reported
    double force = 0;                  ///< magnitude of the newest force [N]
    double depth = 0;                  ///< largest penetration depth [m]
    double seconds = 0, since = 0;     ///< time in contact, and time since the last contact [s]
  };
  void follow(const Contact& contact, double dt) noexcept;

  std::shared_ptr<Touchable> touchable_;
  std::vector<TouchFigures> figures_;
  std::vector<Episode> episodes_;
  std::vector<ContactSample> contacts_;  ///< of the present tick; as long as there are objects
  std::vector<std::size_t> open_;        ///< episodes that have begun
  std::optional<PassivityLayer> layer_;
};

/// Makes the controller that lets a hand touch `scene`, and prepares the scene: for this servo rate, or for the rate in
/// `slow`. With `passivity` a layer supervises the force, even if the scene does not ask for it. Throws what
/// Scene::prepare, SlowScene and PassivityLayer throw.
/// `resolution` of the device's positions [m]; 0: not known.
std::unique_ptr<SceneController> make_scene_controller(
    const std::shared_ptr<Scene>& scene, double rate_hz, const std::optional<SlowSceneOptions>& slow = std::nullopt,
    const std::optional<PassivityLayer::Options>& passivity = std::nullopt, double resolution = 0);

}  // namespace haptrace
