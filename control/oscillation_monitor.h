// Detection of oscillations of the closed loop.
#pragma once

#include "control/controller.h"
#include "control/filters.h"
#include "control/sent_forces.h"

#include <array>
#include <optional>

namespace haptrace {

/// An oscillation of the loop, as detected over OscillationMonitor::kWindow.
struct OscillationVerdict {
  enum class Detector : std::uint8_t {
    energy,  ///< the tracking law gives out more energy than quantised positions could imitate
    ripple,  ///< a mild one: the force feeds a position ripple of about the position resolution
    force,   ///< the force ripples over much of its range, whatever the position shows
  };
  Detector detector = Detector::energy;
  double energy = 0;        ///< energy that the law gave out by the ripple; negative: took in [J]
  double frequency_hz = 0;  ///< rms velocity over rms position of the ripple
  double amplitude = 0;     ///< amplitude of the position ripple about the reference: sqrt(2) times its rms in 3-D [m]
};

/// Properties of the loop and the device.
struct OscillationMonitorOptions {
  double rate_hz = 1000;           ///< servo rate, 10 to 20000 [Hz]
  double max_force = 0;            ///< peak force of the device, above 0 [N]
  double delay = 0;                ///< PlantModel::delay, 0 to 0.1 [s]
  double position_resolution = 0;  ///< PlantModel::position_resolution; 0: unknown [m]
  double mass = 0;                 ///< smallest of PlantModel::mass; 0: unknown [kg]
};

/// Throws Error(input) naming the option that is out of its range.
void validate(const OscillationMonitorOptions& options);

/// Distinguishes a loop that shakes the hand from a hand that shakes the loop.
///
/// A tracking law is a two-port between reference and tool. It is passive if the energy that it takes in, the integral
/// of u . e' with e = x_d - x, never falls for good (Ryu, Kwon and Hannaford, IEEE Trans. Robotics and Automation
/// 20(2), 2004). u is the force that acts: the sent force after all limits, delayed as the device delays it,
/// interpolated between ticks. Without the delay, a law that oscillates because of it seems passive. The same u on both
/// ports keeps forces that a limit cut from being counted as energy. A band pass of 8 to 120 Hz filters e and u. It
/// removes the energy that springs and saturation store and return slowly, and keeps the phase between the two. The
/// energy in the law's spring at the beginning and end of a sum does not count.
///
/// A tremor, a push or a corner makes the law take energy in, or give some out once. An oscillation of the loop lasts,
/// and energy feeds it all the time. Therefore both halves of the window must show that the ripple
///  - does not fade: the second half has at least 0.7 of the amplitude of the first;
///  - is driven by the force: the law gives out energy, with at least half of the force that accelerates the mass;
///  - is large: energy over 2 F q (detector energy), or energy times rms over 0.55 F q^2 and rms over 0.9 q (ripple).
///
/// The detector force requires that the force's rms is over F / 4 above 20 Hz and does not fade, and that the law gives
/// out energy. F is the largest force and q the position resolution, at least 0.05 mm. A rounded position is wrong by
/// up to q / 2. The energy is then wrong by at most q / 2 times the variation of the force (summation by parts): F q is
/// a force that rises and falls by its whole range.
///
/// The factors are fitted to simulated loops (as in tests/player, 1700 stable and 900 oscillating ones): no stable loop
/// was suspected, and 99 % of the oscillations were found within 300 ms of the onset. Two of three judgements make a
/// verdict, because the energy of an oscillation that grows into saturation does not divide evenly into halves. Below
/// 15 Hz, where the window holds few cycles, a verdict needs four judgements in a row.
///
/// Oscillations below 9 Hz are ignored, because hands move at such frequencies.
///
/// Real-time: all but the constructor. Threads: one at a time.
class OscillationMonitor {
 public:
  static constexpr double kWindow = 0.15;  ///< [s]

  /// Throws the errors of validate().
  explicit OscillationMonitor(const OscillationMonitorOptions& options);

  /// Takes the state of every tick with its reference. Returns a verdict at the end of every sixth of a window while
  /// the loop oscillates. A position or reference that is not finite, or a gap of more than five ticks, restarts the
  /// monitor.
  [[nodiscard]] std::optional<OscillationVerdict> update(const State& state, const Reference& reference) noexcept;

  /// Forgets everything.
  void reset() noexcept { begun_ = false; }

 private:
  /// Sums over a stretch of ticks. Each stretch starts from zero, so that rounding errors cannot accumulate.
  struct Sums {
    double position = 0;  ///< sum of |e|^2 [m^2]
    double step = 0;      ///< sum of |e_k - e_k-1|^2 [m^2]
    double force = 0;     ///< sum of |u|^2 [N^2]
    double energy = 0;    ///< sum of u . (e_k - e_k-1) [J]
    double elastic = 0;   ///< sum of u . (e_k + e_k-1) / 2 [J]
    double swing = 0;     ///< sum of |e_k|^2 - |e_k-1|^2 [m^2]
    /// Returns the energy that the law gave out, without that of its spring (u = k e + ...), which returns within a
    /// cycle.
    [[nodiscard]] double given() const noexcept;
    Sums& operator+=(const Sums& other) noexcept;
  };

  /// A second-order Butterworth high pass, then a low pass, of three axes at once.
  class BandPass {
   public:
    explicit BandPass(double rate_hz);
    Vec3 update(const Vec3& x) noexcept { return low_.update(high_.update(x)); }
    /// As if `x` had always been the input.
    void reset(const Vec3& x) noexcept {
      high_.reset(x);
      low_.reset();
    }

   private:
    BasicButterworth2<Vec3> high_, low_;
  };

  void begin(const State& state, const Vec3& error) noexcept;
  std::optional<OscillationVerdict> judge() noexcept;
  /// Returns the detector that fires on the window's halves.
  [[nodiscard]] std::optional<OscillationVerdict::Detector> detect(const Sums& early, const Sums& late,
                                                                   double frequency_hz) const noexcept;

  static constexpr int kStretches = 6;  ///< stretches in a window

  OscillationMonitorOptions options_;
  double quantum_;       ///< position resolution [m]
  int stretch_ticks_;    ///< ticks in a stretch
  double longest_step_;  ///< largest time between ticks [s]

  bool begun_ = false;
  double delay_;  ///< [ticks]
  SentForces sent_;

  BandPass error_band_, force_band_;
  Vec3 error_ = Vec3::Zero();  ///< e after its band pass, at the previous tick [m]
  Sums current_;
  int ticks_ = 0;  ///< ticks in current_
  std::array<Sums, kStretches> stretches_;
  int stretch_ = 0;     ///< index of the oldest of stretches_
  int complete_ = 0;    ///< number of complete stretches_
  unsigned found_ = 0;  ///< one bit per judgement that found an oscillation, the last one lowest
};

}  // namespace haptrace
