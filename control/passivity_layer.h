// Removal of the energy that sampling creates in virtual objects.
#pragma once

#include "control/controller.h"
#include "control/energy_account.h"

#include <vector>

namespace haptrace {

struct LoopModel;

/// A time-domain passivity observer and controller for a device that measures positions and takes forces (Hannaford and
/// Ryu, IEEE Trans. Robotics and Automation 18(1), 2002).
///
/// A sampled spring gives K dx^2 / 2 more energy than it held with every tick that moves it by dx, and K delay dx^2 / T
/// more if its force comes late. The observer sums the energy given to the hand beyond the energy in the objects'
/// springs (EnergyAccount). The springs are the reference energy for the given energy (Ryu, Preusche, Hirzinger and
/// Hannaford, IEEE Trans. Control Systems Technology 13(5), 2005), so that the observer responds within a tick of the
/// creation, and not only after the energy of a whole push is used up. While the sum E is positive, the controller
/// damps by E / (T v^2), at most `max_damping`. On average this is K (T / 2 + delay), the damping that Colgate and
/// Schenkel require of the device. Otherwise the controller does nothing. A damping force on its way to a late device
/// counts as if it had acted: otherwise every tick until the first one acts would ask for the same energy.
///
/// The damping acts on the movement along the force that acted last, because the energy went there: a hand that slides
/// along a smooth wall feels no damping. The velocity is that of the last tick alone, dx / dt, because a filter's lag
/// would cost damping where stiff walls need it. A position resolution q then makes a ripple of about K q / 2 in the
/// force, half of the ripple of the spring itself. If ticks are very short, a hand moves by no count in most ticks and
/// seems to leap in others. Damping for one tick then takes nothing back, and the demand grows. In this case the
/// velocity spans several ticks, so many that one count is at most kSlowQuantum, and the damping force is held as long.
///
/// The energy that dampers take in a contact pays for the energy that springs create in it, but not in the next
/// contact: once no spring holds energy and no force acts, the credit is forgotten.
///
/// Real-time: all but the constructor. Threads: one at a time.
class PassivityLayer {
 public:
  struct Options {
    double delay = 1e-3;  ///< time from sending a force to its effect, 0 to 0.1 [s]
    double rate_hz = 1000;
    double max_damping = 10;  ///< largest damping, see bearable_damping [N s/m]
    double resolution = 0;    ///< position resolution; 0: negligible [m]
  };
  static constexpr double kSlowQuantum = 0.1;  ///< largest velocity of one count [m/s]

  /// Returns the number of ticks from one damping force to the next, at least 1.
  [[nodiscard]] static int held_ticks(double rate_hz, double resolution) noexcept;

  /// Throws Error(input) naming the option that is out of range.
  explicit PassivityLayer(const Options& options);

  /// Forgets contacts and debts; called at the start of a session and after a gap.
  void reset() noexcept;

  /// Returns the force to add to the force of the objects, whose springs hold `stored` [J] at this state's position. If
  /// the state or energy is not finite, returns zero and leaves the account unchanged.
  [[nodiscard]] Vec3 update(const State& state, double stored) noexcept;

  /// Returns the energy given to the hand beyond the energy in springs [J]. A positive value was created and is not yet
  /// taken back; a negative value is credit.
  [[nodiscard]] double energy() const noexcept { return energy_; }

 private:
  void begin_at(const Vec3& position) noexcept;
  Vec3 send(const Vec3& force) noexcept;

  Options options_;
  EnergyAccount account_;
  int held_ticks_;
  double energy_ = 0, damping_ = 0;
  int ticks_ = 0;                 ///< ticks since the damping force was renewed
  double span_ = 0;               ///< time of these ticks [s]
  Vec3 from_ = Vec3::Zero();      ///< position at the renewal [m]
  Vec3 force_ = Vec3::Zero();     ///< damping force [N]
  std::vector<Vec3> on_its_way_;  ///< ring of forces that were sent and do not act yet, the oldest at next_ [N]
  std::size_t next_ = 0;
  Vec3 pending_ = Vec3::Zero();    ///< sum of the ring [N]
  Vec3 direction_ = Vec3::Zero();  ///< direction of the force that acted last; unit, or zero if none did yet
};

/// Returns the largest damping [N s/m] that the layer may apply to a free device: half of the damping up to which the
/// loop is stable (LoopAnalysis::most_damped) with the device's mass and delay, at the rate at which the layer renews
/// its force. A device that is half as heavy as assumed, or later, then does not shake. Ignores `device.velocity`.
/// Throws the errors of LoopAnalysis.
double bearable_damping(LoopModel device);

/// Returns the layer's options for a device: its delay plus its motor lag, and the damping that it withstands. The
/// damping is computed for at most the longest delay of LoopAnalysis, because a later device withstands almost none in
/// any case. Throws the errors of LoopAnalysis.
PassivityLayer::Options passivity_layer_for(LoopModel device);

}  // namespace haptrace
