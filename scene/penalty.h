// The spring and damper of a surface that the tool may enter.
#pragma once

#include "base/json_reader.h"
#include "scene/object.h"

#include <algorithm>
#include <string>

namespace haptrace {

/// How hard a surface is.
struct PenaltySpec {
  double stiffness = 0;  ///< [N/m], 0 to 1e9
  double damping = 0;    ///< resists penetration, never the way out [N s/m], 0 to 1e5
  double lead = 0;       ///< how far ahead of the tool the spring is evaluated [ticks], 0 to 3
};

/// The keys `stiffness` (must be there), `damping` and `lead`. Throws Error(input) naming the key.
PenaltySpec read_penalty(JsonReader& reader);

/// Basdogan and Srinivasan, Fig. 6.2, with a damper that never pulls. For depth > 0 along the normal n, v the velocity:
///
///     F = (k depth + b max(0, -v.n)) n      stored energy k depth^2 / 2
///
/// Where it is evaluated is the knob `lead`: at position + lead T v, T the tick. The force of a tick acts until the
/// next, so that against what a spring would do in continuous time, at a steady speed u of penetration,
///
///     the error is at most k u T max(lead, |1 - lead|), k u T sqrt(1/12 + (lead - 1/2)^2) rms,
///     and a press to depth D and back creates the energy k u T (1 - 2 lead) D.
///
/// Half a tick ahead creates none, to the first order (Ellis, Sarkar and Jenkins 1996); what it costs is the velocity's
/// noise, times k lead T. A device that applies forces a tick late bears a lead of one tick more.
///
/// Real-time: place and contact.
class Penalty {
 public:
  /// `name` of the object, for errors. Throws Error(input) naming what is out of range.
  Penalty(const std::string& name, const PenaltySpec& spec);

  void prepare(const SceneTiming& timing) noexcept;

  [[nodiscard]] Knob knob() const { return {"lead", "ticks", {0, 0.5}, spec_.lead}; }
  /// Throws as the constructor.
  void set_lead(const std::string& name, double lead);

  /// Where the surface is asked about.
  [[nodiscard]] Vec3 place(const Touch& touch) const noexcept { return touch.position + ahead_ * touch.velocity; }

  /// Of the tool at place(touch), `depth` inside a surface with this normal.
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
