// A controller whose hand also feels the objects of a scene.
#pragma once

#include "control/limits.h"
#include "control/passivity_layer.h"
#include "player/session.h"
#include "player/tuning/session_requests.h"
#include "scene/scene_controller.h"

#include <array>
#include <memory>
#include <optional>

namespace haptrace {

/// Adds the force of a scene to that of another controller: F = F_inner + share F_scene, before every limit.
///
/// The scene responds to the position. Its force is therefore feedback, which the loop may soften, and not feedforward.
/// `share` follows the requests from outside, like the feedback of the other controllers.
///
/// Accounts of what acted last:
/// - `inner` gets the whole force in State::force_applied. An observer and iterative learning model the device as
///   m a = force_applied - load. The scene's force is in the motors, so it is no load: they neither cancel nor learn
///   it.
/// - `inner` gets the scene's part in State::force_touched. The energy account of guidance leaves it out.
/// - The passivity layer of the scene gets the scene's part alone. The work of a playback is not energy that sampling
///   created in a contact.
///
/// An event of `inner` comes first; those of the scene wait for a tick without one.
///
/// Real-time: all but the constructor and the results.
class TouchingController final : public Controller {
 public:
  /// Prepares the scene of `touch`, which is not null, for this device and servo rate. `inner` must outlive this
  /// object. Throws what make_scene_controller throws.
  TouchingController(Controller& inner, const TouchOptions& touch, const DeviceInfo& device, double rate_hz);

  void start(const State& first) noexcept override;
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override;

  /// The contacts since the construction. Not real-time.
  [[nodiscard]] const SceneController& scene() const noexcept { return *scene_; }

 private:
  void forget(const State& first) noexcept;

  Controller& inner_;
  std::unique_ptr<SceneController> scene_;
  Vec3 driven_;  ///< 1 for an axis with a motor, else 0
  Mailbox<SessionRequests>* mailbox_;
  bool rests_in_pause_;
  RequestFollower requests_;
  Vec3 touched_ = Vec3::Zero();  ///< of the scene, as sent to the loop at the last tick [N]
};

/// Returns the options of a scene's passivity layer for a device with this position resolution [m] and calibrated model
/// `plant`. An uncalibrated device is assumed to be as late as in guidance (kUnknownDelay) and light (kUnknownMass).
/// That is safe: an overestimated delay overestimates the energy that the loop creates.
PassivityLayer::Options passivity_for(const std::optional<PlantModel>& plant, double rate_hz, double resolution);

}  // namespace haptrace
