// Detects a control loop that vibrates, from the sent force and the measured position alone.
#pragma once

#include "base/types.h"
#include "control/vibration_summary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace haptrace {

struct VibrationAlarm {
  VibrationRule rule = VibrationRule::energy;
  double frequency_hz = 0;
  double ripple = 0;     ///< rms [N, N m]; contacts: half the largest force; slow: that or half the mean peak
  bool remains = false;  ///< remainder of an earlier alarm: less than an alarm needs, more than half of it
};

struct VibrationMonitorOptions {
  double rate_hz = 1000;           ///< servo rate, 10 to 20000 [Hz]
  double max_force = 0;            ///< force limit of the session, above 0 [N]
  double position_resolution = 0;  ///< position resolution of the device; 0: unknown [m]
  double tremor = 0;  ///< peaks of the force with which feedback may answer a known tremor of the hand; 0: none [N]
};

/// Throws Error(input) naming the option that is out of its range.
void validate(const VibrationMonitorOptions& options);

/// Implements the energy rule of VibrationMonitor for a force or a torque of three axes.
///
/// The signal goes through two second-order Butterworth high passes (at 20 Hz in VibrationMonitor). E is the squared
/// norm of their output, low-passed with a time constant of 50 ms. Real-time: all but the constructor.
class RippleEnergy {
 public:
  RippleEnergy(double cutoff_hz, double rate_hz) noexcept;

  /// Returns true while sqrt(E) has been above `threshold` for 0.25 s without a break. `rest` is the level of
  /// remains().
  bool update(const Eigen::Array4f& x, float threshold, float rest, float dt) noexcept {
    const Eigen::Array4f y = second_.update(first_.update(x));
    const Eigen::Array4f step = y - last_;
    last_ = y;
    energy_ += smoothing_ * (y.square().sum() - energy_);
    step_energy_ += smoothing_ * (step.square().sum() - step_energy_);
    worst_ = std::max(worst_, energy_);
    above_ = energy_ > threshold * threshold ? above_ + dt : 0;
    above_rest_ = energy_ > rest * rest ? above_rest_ + dt : 0;
    return above_ > kPersistence;
  }

  /// Returns true while sqrt(E) has been above `rest` for 0.25 s without a break.
  [[nodiscard]] bool remains() const noexcept { return above_rest_ > kPersistence; }

  [[nodiscard]] double rms() const noexcept { return std::sqrt(energy_); }
  /// Returns the largest rms so far.
  [[nodiscard]] double worst() const noexcept { return std::sqrt(worst_); }
  /// Returns the frequency [Hz]: successive samples of a sinusoid differ by 2 sin(w / 2) of its amplitude.
  [[nodiscard]] double frequency() const noexcept;

  /// Implements a second-order Butterworth high pass as a trapezoidal state-variable filter (Simper, "Solving the
  /// continuous SVF equations using trapezoidal integration", 2013): single precision suffices where the cut-off is far
  /// below the rate.
  class HighPass {
   public:
    HighPass(double cutoff_hz, double rate_hz) noexcept;
    [[gnu::always_inline]] Eigen::Array4f update(const Eigen::Array4f& x) noexcept {
      const Eigen::Array4f v3 = x - z2_;
      const Eigen::Array4f v1 = a1_ * z1_ + a2_ * v3;
      const Eigen::Array4f v2 = z2_ + a2_ * z1_ + a3_ * v3;
      z1_ = 2 * v1 - z1_;
      z2_ = 2 * v2 - z2_;
      return x - kDamping * v1 - v2;
    }

   private:
    static constexpr float kDamping = 1.41421356F;
    Eigen::Array4f a1_, a2_, a3_;  ///< each equal for all axes
    Eigen::Array4f z1_ = Eigen::Array4f::Zero(), z2_ = Eigen::Array4f::Zero();
  };

 private:
  static constexpr float kPersistence = 0.25F;  // [s]

  HighPass first_, second_;
  Eigen::Array4f last_ = Eigen::Array4f::Zero();
  double rate_hz_;
  float smoothing_;
  float energy_ = 0, step_energy_ = 0, worst_ = 0;
  float above_ = 0, above_rest_ = 0;  ///< times above the levels [s]
};

/// Distinguishes a loop that vibrates from a hand that moves, without a delay, a mass or a gain.
///
/// A hand cannot sustain a force above about 15 Hz, so a large vibrating force that persists above this frequency comes
/// from the loop. Below it, force and position cannot distinguish hand and loop within half a second; the slow rule is
/// a hint for reversible measures only. F is the session's force limit (at most 12 N count) and A the declared
/// amplitude of an intended vibration:
///  - energy: sqrt(E) of RippleEnergy is above max(0.2 F, A) for 0.25 s.
///  - half_cycles: per axis, high-passed at 5 Hz, the last eight half cycles. Their seven full periods (sums of
///    neighbours) vary by less than 20 % (standard deviation over mean), the last four peaks sum to more than 0.8 of
///    the first four, the smallest is above max(0.3 F, sqrt(2) A), the frequency is above 15 Hz, and no half cycle
///    lasts longer than 150 ms.
///  - contacts: the force is exactly zero between contacts. e is the speed 6 ms after a contact over the speed at its
///    beginning, both along the mean force and over 4 ms. A contact counts if it is shorter than 120 ms, exceeds 0.15
///    F, and began faster than 10 mm/s and than 1.5 counts in 4 ms. It adds 1 to a score if e >= 0.85, otherwise it
///    subtracts 2. An interval above 115 ms between the beginnings of two contacts clears the score: a hand that
///    writes at 8 Hz touches a wall every 125 ms. The alarm is at a score of 4.
///  - slow: half cycles of 4.5 to 16 Hz, each full period within 25 % of their running mean, each peak above 0.6 of the
///    largest, five of them below 10 Hz and seven above, the mean peak above max(0.25 F, sqrt(2) A) and above the
///    answer to a known tremor, but for that no more than 0.6 F. Or four contacts as above with intervals of up to
///    350 ms.
/// The energy rule requires A as rms, which is sqrt(2) of the effect's own: all rules leave the effect that margin.
///
/// After an alarm has caused a reaction, a force above half of the energy rule's limit is a remainder: see remaining().
///
/// docs/monitor.md states what the monitor finds and what it misses.
///
/// A gap in the ticks holds all windows: an oscillation does not end because a tick was late. Real-time: all but the
/// constructor. Threads: one at a time.
class VibrationMonitor {
 public:
  /// Throws the errors of validate().
  explicit VibrationMonitor(const VibrationMonitorOptions& options);

  /// Takes the force sent at this tick, after all limits and without its feedforward [N], the position that it responds
  /// to [m], the declared amplitude A [N] and the time since the previous tick [s]. Returns an alarm, if any. Ignores
  /// values that are not finite.
  [[nodiscard]] std::optional<VibrationAlarm> update(const Vec3& force, const Vec3& position, double declared,
                                                     double dt) noexcept;

  /// Returns the remainder of a vibration that has caused a reaction: sqrt(E) above max(0.1 F, A) for 0.25 s. A force
  /// that was no alarm before is below that once 0.3 of the feedback is left, unless it does not follow the feedback
  /// down.
  [[nodiscard]] std::optional<VibrationAlarm> remaining() const noexcept;

  /// Returns the largest E so far, as rms [N].
  [[nodiscard]] double worst_ripple() const noexcept { return energy_.worst(); }

 private:
  static constexpr int kHalfCycles = 8;
  static constexpr std::size_t kPositions = 128;  ///< more than 4 ms at the highest rate

  /// The half cycles of one axis.
  struct Axis {
    std::array<float, kHalfCycles> length{};  ///< ring [s]
    std::array<float, kHalfCycles> peak{};    ///< ring [N]
    unsigned next = 0;
    int strong = 0;  ///< number of the last ones whose peak is above the threshold
    // Run of similar half cycles, for the slow rule:
    int run = 0;
    float period_sum = 0, peak_sum = 0, least_peak = 0, largest_peak = 0;
  };

  void complete(Axis& axis, float length, float peak, float declared, std::optional<VibrationAlarm>& alarm) noexcept;
  /// Returns the frequency of the last half cycles on the axis with the largest peaks [Hz].
  [[nodiscard]] double frequency() const noexcept;
  [[nodiscard]] std::optional<double> regular(const Axis& axis) const noexcept;
  void watch_contact(const Eigen::Array4f& force, bool touches, std::optional<VibrationAlarm>& alarm) noexcept;
  void judge_contact(std::optional<VibrationAlarm>& alarm) noexcept;
  [[nodiscard]] Eigen::Array4f velocity() const noexcept;

  float period_;          ///< period of the loop [s]
  float energy_limit_;    ///< 0.2 F [N]
  float peak_limit_;      ///< 0.3 F
  float slow_limit_;      ///< 0.25 F
  float contact_limit_;   ///< 0.15 F
  float least_speed_;     ///< least speed at the beginning of a contact [m/s]
  unsigned speed_ticks_;  ///< ticks in 4 ms
  int leave_ticks_;       ///< ticks in 6 ms
  float idle_ = 0;        ///< time without force [s]

  RippleEnergy energy_;
  RippleEnergy::HighPass first_, second_;
  Eigen::Array4f band_ = Eigen::Array4f::Zero();   ///< the force above 5 Hz [N]
  Eigen::Array4f peak_ = Eigen::Array4f::Zero();   ///< peaks of the current half cycles [N]
  Eigen::Array4f since_ = Eigen::Array4f::Zero();  ///< time since their zero crossings [s]
  std::array<Axis, 3> axes_;

  std::array<Eigen::Array4f, kPositions> positions_;  ///< ring [m]
  unsigned newest_ = 0, known_ = 0;                   ///< index of the newest position; number of positions since a gap
  float dt_ = 0;
  bool touching_ = false;
  int leaving_ = 0;                                ///< ticks until an ended contact is judged
  float touched_ = 1;                              ///< time since the last contact began [s]
  float interval_ = 1;                             ///< time between the beginnings of the last two contacts [s]
  float duration_ = 0;                             ///< duration of the contact [s]
  float largest_ = 0;                              ///< largest squared force of the contact [N^2]
  Eigen::Array4f sum_ = Eigen::Array4f::Zero();    ///< sum of its forces [N]
  Eigen::Array4f entry_ = Eigen::Array4f::Zero();  ///< velocity at the beginning of the contact [m/s]
  bool entry_known_ = false;
  int bounces_ = 0, slow_bounces_ = 0;
};

}  // namespace haptrace
