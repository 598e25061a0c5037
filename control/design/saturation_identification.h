// The force at which motors saturate, from an experiment.
#pragma once

#include "control/design/identification.h"

#include <vector>

namespace haptrace {

/// Largest force of the motors.
struct MotorLimit {
  double force = 0;       ///< magnitude [N]; 0: none below `tried` was found
  double half_width = 0;  ///< half width of the 95 % confidence interval [N]
  double tried = 0;       ///< largest magnitude that was sent for long enough to judge [N]
};

/// Identifies the largest force that the motors give, from the strokes under pulses in `experiment`.
///
/// For a limit L, the force of an axis is that of the commands after they are shortened to the magnitude L. Least
/// squares explains it by a, v, x, the integral of x, jerk, friction, an offset and a drift; all columns pass the same
/// Gaussian kernel. With the true limit, the smallest share of the force stays unexplained: above it, the model demands
/// an acceleration that the device does not show. L and the delay are searched. L counts as found if it explains
/// clearly more than commands that arrive whole, and if the interval of the jackknife over tenths of a second ends
/// clearly below the largest force that was tried. The result is a magnitude: motors that saturate one by one have
/// another limit in other directions, and the smallest force at which any of them shows it is found here.
///
/// Not real-time: it allocates, and takes about 0.1 s.
MotorLimit identify_motor_limit(const Experiment& experiment);

/// Shortens the forces of `rows` to the magnitude `limit` [N], so that they are those that the motors gave.
void shorten_forces(std::vector<TickRow>& rows, double limit);

}  // namespace haptrace
