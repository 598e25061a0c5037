// What sampling creates in virtual objects, taken back.
#pragma once

#include "control/energy_account.h"
#include "control/loop_analysis.h"

namespace haptrace {

/// A time-domain passivity observer and controller for a device that measures positions and takes forces (Hannaford and
/// Ryu, IEEE Trans. Robotics and Automation 18(1), 2002).
///
/// A sampled spring gives K dx^2 / 2 more than it held with every tick that moves it by dx, and K delay dx^2 / T more
/// when its force comes late. The observer adds up what was given to the hand beyond what the objects' springs hold
/// (EnergyAccount): the springs are the reference energy that the given one is compared with (Ryu, Preusche, Hirzinger
/// and Hannaford, IEEE Trans. Control Systems Technology 13(5), 2005), so that it speaks within a tick of the creation
/// and not once a whole push is used up. While the sum E is positive the controller damps, by E / (T v^2) and at most
/// `max_damping`, which on average is K (T / 2 + delay): what Colgate and Schenkel ask of the device. While it is not,
/// nothing is done.
///
/// Damped is the movement along the force that acted last, which is where the energy went: who slides along a smooth
/// wall feels none of it. The velocity is the last tick's own, dx / dt, because a filter's lag would cost damping where
/// stiff walls need it; a quantum q of position then makes a ripple of about K q / 2 in the force, half of what the
/// spring itself makes.
///
/// What dampers took in a contact pays for what springs create in it, but not in the next: once nothing is held and no
/// force acts, credit is forgotten.
///
/// Real-time: all but the constructor. Threads: one at a time.
class PassivityLayer {
 public:
  struct Options {
    double delay = 1e-3;  ///< from a force's sending to its effect, 0 to 0.1 [s]
    double rate_hz = 1000;
    double max_damping = 10;  ///< see bearable_damping [N s/m]
  };

  /// Throws Error(input) naming the option that is out of range.
  explicit PassivityLayer(const Options& options);

  /// At the start of a session and after a gap: no contact, no debt.
  void reset() noexcept;

  /// The force to add to that of the objects, whose springs hold `stored` [J] at this state's position. A state or
  /// energy that is not finite gets none, and leaves the account as it was.
  [[nodiscard]] Vec3 update(const State& state, double stored) noexcept;

  /// Given to the hand beyond what springs hold [J]: positive was created and not yet taken back, negative is credit.
  [[nodiscard]] double energy() const noexcept { return energy_; }
  /// In force since the last update [N s/m].
  [[nodiscard]] double damping() const noexcept { return damping_; }

 private:
  Options options_;
  EnergyAccount account_;
  double energy_ = 0, damping_ = 0;
  Vec3 position_ = Vec3::Zero();   ///< at the tick before [m]
  Vec3 direction_ = Vec3::Zero();  ///< of the force that acted last; unit, or zero when none did yet
};

/// The damping [N s/m] that a free device bears of the layer: half of the largest with which the loop of its mass,
/// delay and rate is stable (LoopAnalysis::most_damped), so that a device twice as light as it is taken for, or later,
/// does not shake. `device.velocity` and `device.resolution` do not count. Throws what LoopAnalysis throws.
double bearable_damping(LoopModel device);

}  // namespace haptrace
