// What Haply's Inverse Service says and is told, as JSON; nothing of the network.
//
// After Haply's documentation of the Inverse SDK 3.5 (WebSocket protocol, control commands, basis, mount) and published
// programs that talk to 3.1. Vectors stand in the service's own axes: x right, y forward, z up; m, m/s, N.
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

/// Under which key the service looks for a force: "vector" in the documentation of 3.5, "values" in programs for 3.1.
enum class InverseForceKey : std::uint8_t { vector, values };

const char* to_string(InverseForceKey key) noexcept;

/// An arm, as far as the service has described it. What it never told is false or zero.
struct InverseArm {
  std::string type;                    ///< "inverse3", "inverse3x", "minverse"
  Vec3 position = Vec3::Zero();        ///< of the cursor [m]
  std::optional<Vec3> velocity;        ///< of the cursor, if it ever told one [m/s]
  bool powered = false;                ///< by its own supply, without which it has no force
  bool calibrated = false;             ///< without which its positions mean nothing
  bool ready = false;                  ///< in the service's own judgement
  bool in_use = false;                 ///< by some program, perhaps this one
  std::vector<std::string> displaced;  ///< settings that turn, scale or move the service's axes, as "basis XZY"

  /// Placement of the service's axes: position [m], rotation (w, x, y, z) and scale of the mount, then of the
  /// transform.
  std::array<double, 20> placement{};
  std::string basis;               ///< permutation and signs of the axes, as "+X+Y+Z"
  std::string handedness, preset;  ///< empty: never stated
  std::string filters;             ///< JSON text; empty: never stated

  /// Takes from `now` the settings that were not stated before.
  void complete(const InverseArm& now);
};

/// The first setting of `now` that differs from `before` and changes what a position or a force means, as "basis +X+Y+Z
/// became -X+Y+Z"; empty when none does. A setting that was never stated before counts as unchanged, except for the
/// basis, the mount and the transform, whose defaults are known.
std::string changed_setting(const InverseArm& before, const InverseArm& now);

/// An event of the service's event channel (Inverse SDK 3.5, "Events & Monitoring").
struct InverseEvent {
  std::string name;     ///< "device-safety-triggered", ...
  std::string type;     ///< safety_type of a safety event: "ebrake_triggered", ...
  std::string device;   ///< device_id; empty: not stated
  std::string level;    ///< "info", "notice", "warning", "error", "critical", "panic"
  std::string message;  ///< for people

  /// True when the arm no longer does what it is told: a safety event above the level "notice", or an arm that is gone.
  [[nodiscard]] bool ends_control() const noexcept;
};

/// Nothing when the message is no event. Does not throw.
std::optional<InverseEvent> inverse_event(const std::string& message);

/// The pen at the arm's end, wired or wireless.
struct InverseGrip {
  Quat orientation = Quat::Identity();
  std::uint32_t buttons = 0;  ///< bit 0 is a, bit 1 b, bit 2 c
};

/// What keeps an arm from being used, and what mends it. Both empty: nothing.
struct InverseObstacle {
  std::string what, remedy;
};

/// `ours`: whether a program that uses the arm can be none but this one.
InverseObstacle obstacle_of(const InverseArm& arm, bool ours);

/// Everything that a service has said since it was connected to. It leaves out of a message what has not changed or is
/// at its default; so what is left out stays as it was, and is at its default as long as it was never told. (Were a
/// position left out because it became zero, it would be an old one for a message: a jump to zero would be worse.)
///
/// Threads: one at a time. Not real-time.
class InverseServiceView {
 public:
  /// The next message. Throws Error(device) when it is none that such a service sends.
  void take(const std::string& message);

  /// The arms that the newest message named.
  [[nodiscard]] const std::vector<std::string>& listed() const noexcept { return listed_; }
  [[nodiscard]] bool lists(const std::string& id) const noexcept;

  /// What the newest message refused; empty when nothing.
  [[nodiscard]] const std::string& refusal() const noexcept { return refusal_; }

  /// Throws Error(device) when a field is of another type than it should be.
  [[nodiscard]] InverseArm arm(const std::string& id) const;

  /// The first grip that was ever told of, wireless ones before wired ones. Throws likewise.
  [[nodiscard]] std::optional<InverseGrip> grip() const;

  /// By what only 3.5 tells of an arm (its basis, mount, preset or filters).
  [[nodiscard]] InverseForceKey force_key() const;

 private:
  using Devices = std::map<std::string, nlohmann::json>;  ///< by their ids

  std::map<std::string, Devices> kinds_;  ///< "inverse3", "verse_grip", "wireless_verse_grip"
  std::vector<std::string> listed_;
  std::string refusal_;
};

/// The message that asks for `force` [N], which is finite, for as long as none follows. The first one of a session says
/// who asks.
std::string inverse_command(const std::string& id, const Vec3& force, InverseForceKey key, bool first);

}  // namespace haptrace
