// What sampling creates in virtual objects, taken back.
#pragma once

#include "control/design/loop_analysis.h"
#include "control/energy_account.h"

#include <vector>

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
/// nothing is done. What is on its way to a late device counts as if it had taken its part: else the damping of every
/// tick until the first acts would be asked for the same energy.
///
/// Damped is the movement along the force that acted last, which is where the energy went: who slides along a smooth
/// wall feels none of it. The velocity is the last tick's own, dx / dt, because a filter's lag would cost damping where
/// stiff walls need it; a quantum q of position then makes a ripple of about K q / 2 in the force, half of what the
/// spring itself makes. Where ticks are so short that a hand mostly moves by no quantum in one and seems to leap in the
/// next, damping for a tick takes nothing back, and ever more is asked: there the velocity is that of several ticks, so
/// many that a quantum is at most kSlowQuantum, and the damping force is held as long.
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
    double resolution = 0;    ///< of the positions; 0 when they have none worth mentioning [m]
  };
  static constexpr double kSlowQuantum = 0.1;  ///< [m/s]

  /// Ticks from one damping force to the next, at least 1.
  [[nodiscard]] static int held_ticks(double rate_hz, double resolution) noexcept;

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
  void begin_at(const Vec3& position) noexcept;
  Vec3 send(const Vec3& force) noexcept;

  Options options_;
  EnergyAccount account_;
  int held_ticks_;
  double energy_ = 0, damping_ = 0;
  int ticks_ = 0;                 ///< since the damping force was renewed
  double span_ = 0;               ///< their time [s]
  Vec3 from_ = Vec3::Zero();      ///< the position then [m]
  Vec3 force_ = Vec3::Zero();     ///< that damps [N]
  std::vector<Vec3> on_its_way_;  ///< what was sent and does not act yet: a ring, oldest at next_ [N]
  std::size_t next_ = 0;
  Vec3 pending_ = Vec3::Zero();    ///< its sum [N]
  Vec3 direction_ = Vec3::Zero();  ///< of the force that acted last; unit, or zero when none did yet
};

/// The damping [N s/m] that a free device bears of the layer: half of the largest with which the loop of its mass,
/// delay and rate, as often as the layer renews its force, is stable (LoopAnalysis::most_damped), so that a device
/// twice as light as it is taken for, or later, does not shake. `device.velocity` does not count. Throws what
/// LoopAnalysis throws.
double bearable_damping(LoopModel device);

/// The layer for a device: as late as its delay and motor lag together, and damping what it bears. A device later than
/// LoopAnalysis goes counts there as late as that goes: it bears next to nothing in any case. Throws what LoopAnalysis
/// throws.
PassivityLayer::Options passivity_layer_for(LoopModel device);

}  // namespace haptrace
