// JSON messages of Haply's Inverse Service, independent of the network.
//
// Sources: Haply's documentation of the Inverse SDK 3.5 (WebSocket protocol, control commands, basis, mount) and
// published programs for 3.1. Vectors are in the service's own axes: x right, y forward, z up; m, m/s, N.
#pragma once

#include "base/types.h"

#include <array>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Key under which the service expects a force: "vector" in the documentation of 3.5, "values" in programs for 3.1.
enum class InverseForceKey : std::uint8_t { vector, values };

const char* to_string(InverseForceKey key) noexcept;

/// An arm, as far as the service has described it. Values that it never reported are false or zero.
struct InverseArm {
  std::string type;                    ///< "inverse3", "inverse3x", "minverse"
  Vec3 position = Vec3::Zero();        ///< cursor position [m]
  std::optional<Vec3> velocity;        ///< cursor velocity, if ever reported [m/s]
  bool powered = false;                ///< has its own power supply, without which it has no force
  bool calibrated = false;             ///< if not, its positions mean nothing
  bool ready = false;                  ///< ready in the service's judgement
  bool in_use = false;                 ///< in use by any program, perhaps this one
  std::vector<std::string> displaced;  ///< settings that rotate, scale or move the service's axes, such as "basis XZY"

  /// Placement of the service's axes: position [m], rotation (w, x, y, z) and scale of the mount, then of the
  /// transform.
  std::array<double, 20> placement{};
  std::string basis;               ///< permutation and signs of the axes, such as "+X+Y+Z"
  std::string handedness, preset;  ///< empty: never reported
  std::string filters;             ///< JSON text; empty: never reported

  /// Takes from `now` the settings that were not reported before.
  void complete(const InverseArm& now);
};

/// Returns the first setting of `now` that differs from `before` and changes the meaning of a position or a force, such
/// as "basis +X+Y+Z became -X+Y+Z"; empty if none does. A setting that was never reported before counts as unchanged,
/// except for the basis, the mount and the transform, whose defaults are known.
std::string changed_setting(const InverseArm& before, const InverseArm& now);

/// An event of the service's event channel (Inverse SDK 3.5, "Events & Monitoring").
struct InverseEvent {
  std::string name;     ///< "device-safety-triggered", ...
  std::string type;     ///< safety_type of a safety event: "ebrake_triggered", ...
  std::string device;   ///< device_id; empty: not stated
  std::string level;    ///< "info", "notice", "warning", "error", "critical", "panic"
  std::string message;  ///< text for the user

  /// Returns whether the arm no longer follows commands: a safety event above the level "notice", or a disconnection.
  [[nodiscard]] bool ends_control() const noexcept;
};

/// Parses a message of the event channel; returns nothing if it is no event. Does not throw.
std::optional<InverseEvent> inverse_event(const std::string& message);

/// The pen at the arm's end, wired or wireless.
struct InverseGrip {
  Quat orientation = Quat::Identity();
  std::uint32_t buttons = 0;  ///< bit 0 is a, bit 1 b, bit 2 c
};

/// An obstacle to using an arm, and its remedy. Both are empty if there is none.
struct InverseObstacle {
  std::string what, remedy;
};

/// Returns the obstacle to using `arm`. If `ours`, a program that uses the arm can only be this one.
InverseObstacle obstacle_of(const InverseArm& arm, bool ours);

/// Accumulates the messages of a service since the connection. The service leaves out of a message the values that have
/// not changed or are at their defaults. So a value that is left out keeps its last reported value, or its default if
/// it was never reported. (If a position were left out because it became zero, it would be outdated for one message; a
/// jump to zero would be worse.)
///
/// Threads: one at a time. Not real-time.
class InverseServiceView {
 public:
  /// Takes the next message. Throws Error(device) if it is not a message of such a service.
  void take(const std::string& message);

  /// Returns the arms that the newest message lists.
  [[nodiscard]] const std::vector<std::string>& listed() const noexcept { return listed_; }
  [[nodiscard]] bool lists(const std::string& id) const noexcept;

  /// Returns the error that the newest message reports; empty if none.
  [[nodiscard]] const std::string& refusal() const noexcept { return refusal_; }

  /// Returns an arm as reported so far. Throws Error(device) if a field has the wrong type.
  [[nodiscard]] InverseArm arm(const std::string& id) const;

  /// Returns the first grip that was ever reported, wireless ones before wired ones. Throws like arm().
  [[nodiscard]] std::optional<InverseGrip> grip() const;

  /// Derives the force key from values of an arm that only 3.5 reports (its basis, mount, preset or filters).
  [[nodiscard]] InverseForceKey force_key() const;

 private:
  using Devices = std::map<std::string, nlohmann::json>;  ///< devices by id

  std::map<std::string, Devices> kinds_;  ///< "inverse3", "verse_grip", "wireless_verse_grip"
  std::vector<std::string> listed_;
  std::string refusal_;
};

/// Returns the message that requests `force` [N], which is finite, until the next message. The first message of a
/// session also names the client.
std::string inverse_command(const std::string& id, const Vec3& force, InverseForceKey key, bool first);

}  // namespace haptrace
