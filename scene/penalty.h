// Penalty force of a surface: a spring and a damper.
#pragma once

#include "base/json_reader.h"
#include "scene/object.h"

#include <algorithm>
#include <string>

namespace haptrace {

/// Stiffness and damping of a surface.
struct PenaltySpec {
  double stiffness = 0;  ///< [N/m], 0 to 1e9
  double damping = 0;    ///< resists only further penetration, not the way out [N s/m], 0 to 1e5
  double lead = 0;       ///< time by which the spring is evaluated ahead of the tool [ticks], 0 to 3
};

/// Reads the keys `stiffness` (required), `damping` and `lead`. Throws Error(input) naming the key.
PenaltySpec read_penalty(JsonReader& reader);

/// Penalty force of Basdogan and Srinivasan, Fig. 6.2, with a damper that never pulls. For depth > 0 along the normal n
/// and the velocity v:
///
///     F = (k depth + b max(0, -v.n)) n      stored energy k depth^2 / 2
///
/// The accuracy setting `lead` sets the point of evaluation: position + lead T v, with T the tick. The force of a tick
/// acts until the next. Compared with a spring in continuous time, at a steady speed u of penetration,
///
///     the error is at most k u T max(lead, |1 - lead|), k u T sqrt(1/12 + (lead - 1/2)^2) rms,
///     and a press to depth D and back creates the energy k u T (1 - 2 lead) D.
///
/// A lead of half a tick creates no energy to the first order (Ellis, Sarkar and Jenkins 1996). Its cost is the noise
/// of the velocity times k lead T. On a device that applies forces one tick late, the same holds for one tick more of
/// lead.
///
/// Real-time: place and contact.
class Penalty {
 public:
  /// `name` is the object's name, for errors. Throws Error(input) naming the value that is out of range.
  Penalty(const std::string& name, const PenaltySpec& spec);

  void prepare(const SceneTiming& timing) noexcept;

  [[nodiscard]] Knob knob() const { return {"lead", "ticks", {0, 0.5}, spec_.lead}; }
  /// Throws like the constructor.
  void set_lead(const std::string& name, double lead);

  /// Returns the point at which the surface is evaluated.
  [[nodiscard]] Vec3 place(const Touch& touch) const noexcept { return touch.position + ahead_ * touch.velocity; }

  /// Returns the contact of a tool at place(touch), `depth` inside a surface with this normal.
  [[nodiscard]] Contact contact(const Touch& touch, const Vec3& place, const Vec3& normal,
                                double depth) const noexcept {
    Contact contact{
        .place = place, .normal = normal, .depth = depth, .stiffness = spec_.stiffness, .damping = spec_.damping};
    if (!(depth > 0)) return contact;
    const double resisted = std::max(0.0, -touch.velocity.dot(normal));
    contact.force = (spec_.stiffness * depth + spec_.damping * resisted) * normal;
    contact.stored = 0.5 * spec_.stiffness * depth * depth;
    return contact;
  }

 private:
  PenaltySpec spec_;
  double tick_ = 1e-3;  ///< [s]
  double ahead_ = 0;    ///< [s]
};

}  // namespace haptrace
