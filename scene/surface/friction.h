// Dry and viscous friction of a contact.
#pragma once

#include "base/json_reader.h"
#include "base/types.h"
#include "scene/surface/surface.h"

#include <cstdint>
#include <optional>

namespace haptrace {

/// Coefficients that vary along an axis of the shape's frame.
struct PeriodicFriction {
  double period = 1e-3;       ///< [m]
  double amplitude = 0;       ///< share of the coefficient, 0 to 1
  Vec3 axis = Vec3::UnitX();  ///< unit
};

/// Coefficients that vary from grain to grain, with a normal distribution cut off at zero (Green and Salisbury 1997).
/// They are drawn from the place, so that a second stroke feels the same.
struct SandpaperFriction {
  double sigma = 0;     ///< of the coefficient, as a share of it
  double grain = 1e-3;  ///< edge of a grain [m]
  std::uint64_t seed = 0;
};

struct FrictionSpec {
  double fixed = 0;    ///< static coefficient, 0 to 10; at least the dynamic one
  double dynamic = 0;  ///< Coulomb coefficient while sliding, 0 to 10
  double bristle = 0;  ///< stiffness before the tool slides [N/m], above 0 to 1e9
  double damping = 0;  ///< of the bristle, before the tool slides [N s/m], 0 to 1e4
  double viscous = 0;  ///< force per speed [N s/m], 0 to 100
  std::optional<PeriodicFriction> periodic;
  std::optional<SandpaperFriction> sandpaper;
};

/// Friction of Coulomb in series with a damped elastic bristle (Kikuuwe, Takesue, Sano, Mochiyama and Fujimoto 2006),
/// by one implicit step a tick. The bristle z is stretched by the tool's tangential movement, and carries
/// K z + B dz/dt. Where the surface turns, the bristle is projected onto it. Its energy, K z^2 / 2, is therefore never
/// more than the work that the movement put in, on any shape: its damper takes energy, and sliding does. The work of a
/// tick is that of its force along the step that ends there.
///
/// Real-time: pull.
class Friction {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Friction(const FrictionSpec& spec);

  /// Returns the force on the hand [N], and moves the bristle. `normal` is the surface's unit normal, `load` the normal
  /// force [N]; no load, no friction.
  [[nodiscard]] Vec3 pull(const Press& press, const Vec3& normal, double load, SurfaceMemory& memory) const noexcept;

  /// Returns the energy in the bristle [J].
  [[nodiscard]] double stored(const SurfaceMemory& memory) const noexcept {
    return 0.5 * spec_.bristle * memory.bristle.squaredNorm();
  }

 private:
  [[nodiscard]] double variation(const Vec3& place) const noexcept;

  FrictionSpec spec_;
};

/// Reads {"static", "dynamic", "bristle", "damping", "viscous", "periodic": {...}, "sandpaper": {...}}. `bristle`
/// defaults to `stiffness` [N/m].
Friction read_friction(JsonReader reader, double stiffness);

}  // namespace haptrace
