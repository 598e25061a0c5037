// The plain surface: a spring and a damper.
#pragma once

#include "base/json_reader.h"
#include "scene/surface/surface.h"

#include <algorithm>
#include <memory>

namespace haptrace {

/// Stiffness and damping of a surface.
struct ElasticSpec {
  double stiffness = 0;  ///< [N/m], 0 to 1e9
  double damping = 0;    ///< resists only further penetration, not the way out [N s/m], 0 to 1e5
  double lead = 0;       ///< time by which the spring is evaluated ahead of the tool [ticks], 0 to 3
};

/// Reads the keys `stiffness` (required), `damping` and `lead`. Throws Error(input) naming the key.
ElasticSpec read_elastic(JsonReader& reader);
/// The same without `stiffness`, which stays 0.
ElasticSpec read_damping(JsonReader& reader);

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
class ElasticSurface final : public Surface {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit ElasticSurface(const ElasticSpec& spec);

  void prepare(const SceneTiming& timing) override { ahead_ = spec_.lead / timing.rate_hz; }
  [[nodiscard]] Contact press(const Press& press, SurfaceMemory&) const noexcept override {
    const Proxy& proxy = press.proxy;
    Contact contact{.place = press.step.to,
                    .proxy = proxy.position,
                    .normal = proxy.normal,
                    .depth = proxy.depth,
                    .stiffness = spec_.stiffness,
                    .damping = spec_.damping};
    if (!(proxy.touching && proxy.depth > 0)) return contact;
    const double resisted = std::max(0.0, -press.velocity.dot(proxy.normal));
    contact.force = (spec_.stiffness * proxy.depth + spec_.damping * resisted) * proxy.normal;
    contact.stored = 0.5 * spec_.stiffness * proxy.depth * proxy.depth;
    return contact;
  }
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

 private:
  ElasticSpec spec_;
};

/// Returns the accuracy setting `lead`, which every surface has.
Knob lead_knob(double level);

}  // namespace haptrace
