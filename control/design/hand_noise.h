// The tremor of the hand that holds a device.
#pragma once

#include "control/design/identification.h"

namespace haptrace {

struct HandNoiseIdentification {
  HandNoise noise;       ///< tremor 0 unless it stands out; the drift is not identified
  HandNoise half_width;  ///< half widths of the 95 % confidence intervals
  double evidence = 0;   ///< for a tremor, 2 ln of the likelihood ratio less the cost of its numbers; clear above 10
};

/// Finds the tremor of the hand in an experiment with an excitation signal, for the device and hand of `held`.
///
/// Between the lines of the excitation signal, a device moves only by forces of others. At those frequencies f from 4.5
/// to 24 Hz, in every window at the centre and at the places, the force that motors at rest would meet is
///
///     E = (m s^2 + b s + z) X - e^{-s delay} hold(s) / (1 + s lag) U,   s = j 2 pi f
///
/// with z and h as in held_response(). A tremor t makes it h t. Its standard deviation and frequency, the same for all
/// axes, maximise the likelihood of all E (Whittle 1953, Arkiv for Matematik 2(5)) with the variance
///
///     4 / period (|h|^2 S_t + c^2 + |m s^2 + b s + z|^2 S_y),   S_t = 4 zeta w^3 tremor^2 / |w^2 + 2 zeta w s + s^2|^2
///
/// S_y: the noise of the positions of `plant`. c^2 takes what else differs from window to window. At the harmonics
/// of the movement under the excitation, the friction of the plant adds the square of 4 F_c / (pi n) for harmonic
/// n. zeta is 0.3, or 0.04 where that is likelier and the tremor then larger: many tremors of an illness are
/// narrow. A tremor is accepted if its evidence is clear, it is above 0.15 N, since a healthy hand has less, and it
/// is below 16.5 Hz, since no hand trembles faster. Not real-time: it allocates.
HandNoiseIdentification identify_hand_noise(const Experiment& experiment, const HeldModel& held,
                                            const PlantModel& plant);

/// Force of a tremor on motors that hold still, rms per axis [N]; zero where nothing is driven.
struct TremorForce {
  Vec3 whole = Vec3::Zero();
  Vec3 ripple = Vec3::Zero();  ///< what a RippleModel passes
};

/// Returns the force of the tremor of `held.noise`.
TremorForce tremor_at_motors(const HeldModel& held) noexcept;

}  // namespace haptrace
