// Identification of how the mass of a device varies over its workspace.
#pragma once

#include "control/design/identification.h"
#include "control/inertia_map.h"

#include <optional>

namespace haptrace {

/// Mass at a place over that at the centre, as measured.
struct InertiaFactor {
  Vec3 factor = Vec3::Ones();
  Vec3 deviation = Vec3::Zero();  ///< standard deviation; infinity: the device did not move enough to tell
};

/// Returns the factors at the places of an experiment, in their order: from the responses to the excitation signal at
/// its lines above 25 Hz,
///
///     s - 1 = Re[(1 / H_place - 1 / H_centre) / (m (jw)^2 e^{jw (delay + T / 2)})],   H = X / F
///
/// weighted by the noise. A hand that acts alike at both places cancels out. Returns nothing if a place was recorded
/// incompletely, or if `identified`, the result for the centre, does not fit. Not real-time: it allocates.
std::optional<std::vector<InertiaFactor>> inertia_factors(const Experiment& experiment,
                                                          const Identification& identified);

/// Fits a map to the factors at the places of an experiment, by least squares weighted by their deviations. Its `reach`
/// is 1.1 times that of the places. Its `curve` is 0 if the places along each axis are all equally far away. An axis
/// without places is taken to be like the others, where these become lighter. Returns nothing if there are no factors,
/// or if they do not show more than noise: no factor differs from 1 by more than kLeastVariation and three deviations.
std::optional<InertiaMap> identify_inertia(const Experiment& experiment, const Identification& identified);
inline constexpr double kLeastVariation = 0.15;

}  // namespace haptrace
