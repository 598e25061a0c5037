// Identification of a force that is locked to the place.
#pragma once

#include "control/cogging.h"
#include "control/design/identification.h"

#include <optional>
#include <vector>

namespace haptrace {

/// Shares of the force that all waves leave unexplained, as sums of squares: each wave must explain as much. Waves that
/// noise feigns keep their phase for a few millimetres, but not from place to place. On 56 random devices measured at
/// up to nine places, they then explained at most 0.046, mostly below 0.02.
struct CoggingShares {
  double near = 0.03;        ///< near the centre: looked for at the other places, too
  double everywhere = 0.04;  ///< over all places
};

/// Finds the force that repeats over the place, with periods of 2 to 20 mm, of a device with motors along all axes.
///
/// The force sent, the movement and the waves pass the same Gaussian kernel, so that a wave that passes quickly keeps
/// its amplitude. From each piece of the experiment, least squares removes what the movement explains: mass, damping,
/// stiffness and a hand, in all directions, friction along each axis, and a slow drift. In the rest, a spectrum over
/// wave numbers shows the waves, one after the other, from the measurements near the centre. Gauss-Newton over all wave
/// numbers and amplitudes then takes in one place after the other, from the nearest to the farthest, since each place
/// makes the wave numbers, and thus the phase at the next, more accurate.
///
/// A wave is accepted if it explains the `required` shares, a fifth if nothing was measured away from the centre, and
/// if the interval of its amplitude, from the jackknife over the pieces, excludes half of it. Returns nothing if there
/// is none. The amplitudes are too small by 10 to 40 %; see refit_amplitudes(). `delay` is that of PlantModel [s]. Not
/// real-time: it allocates, and takes up to a second.
std::optional<Cogging> find_cogging(const Experiment& experiment, double delay, const CoggingShares& required = {});

/// Corrects the amplitudes of `cogging`, for a known mass matrix at the centre [kg], by the measurements with
/// excitation there. find_cogging() leaves the mass free, and as the law that holds the device also makes the force
/// follow from the movement, the noise of the acceleration makes the mass, and the force that accelerates it, too
/// small. This concerns all waves alike, so that one factor for all of them is the most accurate correction. It hardly
/// concerns the phases. `delay` as above. Not real-time.
void refit_amplitudes(const Experiment& experiment, const Eigen::Matrix3d& mass, double delay, Cogging& cogging);

/// Returns the rows with the force of `cogging` added to the force sent: those of the same movement of a device without
/// it. `delay` as above.
std::vector<TickRow> without_cogging(const Experiment& experiment, const Cogging& cogging, double delay);

}  // namespace haptrace
