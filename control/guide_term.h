// A summand of guidance: its input, its effect on energy, and the changes while it runs.
#pragma once

#include "control/controller.h"
#include "control/path/path_projection.h"

#include <algorithm>
#include <memory>
#include <vector>

namespace haptrace {

/// Changes of guidance while it runs, relative to the terms as they were composed. Plain data, to be posted through a
/// Mailbox.
struct GuideTuning {
  double radius_scale = 1;   ///< factor on the path's radius ...
  double radius_offset = 0;  ///< ... to which this is added [m]
  double stiffness = 1;      ///< factor on the stiffness of the walls
  double damping = 1;        ///< factor on the damping in the walls
  double force = 1;          ///< factor on the expert's force
  double assist = 1;         ///< factor on the force that helps along the path
  double share = 1;          ///< factor on all forces, 0 to 1

  /// Returns the radius of the tunnel for a path's `radius` [m].
  [[nodiscard]] double radius(double radius) const noexcept {
    return std::max(0.0, radius_scale * radius + radius_offset);
  }
};

/// Input of a guidance term.
struct GuideInput {
  const State& state;
  const PathProjection::Foot& foot;  ///< with the radius in force; walls act on its tube, other forces at its place
  double gate = 1;                   ///< closeness of the trainee to the path: 1 within the tunnel, 0 far from it
  GuideTuning tuning = {};           ///< in force
};

/// One summand of guidance. A session holds only the terms that it is composed of.
///
/// Real-time: all.
class GuideTerm {
 public:
  /// Effect of a term on energy.
  enum class Kind {
    restoring,    ///< a spring: gives back at most the energy that it holds, see stored()
    dissipative,  ///< only takes energy
    active,       ///< may give energy: draws from the tank
  };

  virtual ~GuideTerm() = default;
  [[nodiscard]] virtual Kind kind() const noexcept = 0;
  /// Returns the force on the hand, in W [N].
  [[nodiscard]] virtual Vec3 force(const GuideInput& input) noexcept = 0;
  /// Returns the energy that a restoring term holds [J]. The foot has the radius in force.
  [[nodiscard]] virtual double stored(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept {
    (void)foot, (void)tuning;
    return 0;
  }
  /// Returns the energy that the path allows an active term to give per metre, on the first pass [J/m].
  [[nodiscard]] virtual double allowance(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept {
    (void)foot, (void)tuning;
    return 0;
  }
};

using GuideTerms = std::vector<std::unique_ptr<GuideTerm>>;

}  // namespace haptrace
