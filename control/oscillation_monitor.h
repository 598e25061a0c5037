// Notices that the closed loop oscillates.
#pragma once

#include "control/controller.h"
#include "control/filters.h"
#include "control/sent_forces.h"

#include <array>
#include <optional>

namespace haptrace {

/// An oscillation of the loop, as seen over OscillationMonitor::kWindow.
struct OscillationVerdict {
  enum class Detector : std::uint8_t {
    energy,  ///< the tracking law gives out more energy than quantised positions could feign
    ripple,  ///< a mild one: the force feeds a ripple of the position of about a quantum
    force,   ///< the force ripples over much of its range, whatever the position shows
  };
  Detector detector = Detector::energy;
  double energy = 0;        ///< that the law gave out by rippling; negative: took in [J]
  double frequency_hz = 0;  ///< rms velocity over rms position of the ripple
  double amplitude = 0;     ///< of the position's ripple about the reference: sqrt(2) times its rms in 3-D [m]
};

/// What the monitor knows of loop and device.
struct OscillationMonitorOptions {
  double rate_hz = 1000;           ///< of the servo loop [10, 20000]
  double max_force = 0;            ///< of the device, above 0 [N]
  double delay = 0;                ///< PlantModel::delay, 0 to 0.1 [s]
  double position_resolution = 0;  ///< PlantModel::position_resolution; 0: not known [m]
  double mass = 0;                 ///< smallest of PlantModel::mass; 0: not known [kg]
};

/// Throws Error(input) naming the option that is out of its range.
void validate(const OscillationMonitorOptions& options);

/// Tells a loop that shakes the hand from a hand that shakes the loop.
///
/// A tracking law is a two-port between reference and tool, and passive if what it takes in, the integral of u . e'
/// with e = x_d - x, never falls for good (Ryu, Kwon and Hannaford, IEEE Trans. Robotics and Automation 20(2), 2004). u
/// is the force that acts: what was sent after all limits, delayed as the device delays it, interpolated between ticks.
/// Without the delay a law that oscillates because of it seems passive. One and the same u on both ports keeps forces
/// that a limit cut from being counted as energy. e and u are both seen through a band pass of 8 to 120 Hz, which
/// takes out what springs and saturation store and return slowly, and keeps the phase between the two. What the law's
/// spring holds of the ripple where a sum begins and ends does not count.
///
/// A tremor, a push or a corner makes the law take energy in, or give some out once. An oscillation of the loop goes on
/// and goes on being fed. So the window's two halves must both say of the ripple that
///  - it does not fade: the second has at least 0.7 of the first one's amplitude;
///  - the force drives it: energy is given out, and the force is at least half of what accelerates the mass so;
///  - and it is large: energy over 2 F q (detector energy), or energy times rms over 0.55 F q^2 and rms over 0.9 q
///    (ripple), or the force's rms over F / 4 above 20 Hz (force), with F the largest force and q the quantum, at least
///    0.05 mm. A rounded position is wrong by up to q / 2, and so is the energy by at most q / 2 times the variation of
///    the force (summation by parts): F q is a force that rises and falls by its whole range.
/// The factors are fitted to simulated loops (as in tests/player, 1700 stable and 900 oscillating ones): none that was
/// stable suspected, 99 % found within 300 ms of the onset. Two of three judgements make a verdict, since the
/// energy of one that grows into saturation does not divide evenly into halves; below 15 Hz, where the window holds few
/// cycles, four in a row.
///
/// Oscillations below 9 Hz are not looked for: hands move so.
///
/// Real-time: all but the constructor. Threads: one at a time.
class OscillationMonitor {
 public:
  static constexpr double kWindow = 0.15;  ///< [s]

  /// Throws what validate throws.
  explicit OscillationMonitor(const OscillationMonitorOptions& options);

  /// To be called at every tick, with the reference that goes with the state. Answers at the end of every sixth of a
  /// window while the loop oscillates. A position or reference that is not finite, and a gap of more than five ticks,
  /// begin everything anew.
  [[nodiscard]] std::optional<OscillationVerdict> update(const State& state, const Reference& reference) noexcept;

  /// Forgets everything.
  void reset() noexcept { begun_ = false; }

 private:
  /// Sums over a stretch of ticks. They are made anew for every stretch, so that rounding errors cannot gather.
  struct Sums {
    double position = 0;  ///< of |e|^2 [m^2]
    double step = 0;      ///< of |e_k - e_k-1|^2 [m^2]
    double force = 0;     ///< of |u|^2 [N^2]
    double energy = 0;    ///< of u . (e_k - e_k-1) [J]
    double elastic = 0;   ///< of u . (e_k + e_k-1) / 2 [J]
    double swing = 0;     ///< of |e_k|^2 - |e_k-1|^2 [m^2]
    /// What the law gave out, less what the spring in it did: u = k e + ..., whose energy comes back within a cycle.
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
  /// Which detector fires on the window's halves.
  [[nodiscard]] std::optional<OscillationVerdict::Detector> detect(const Sums& early, const Sums& late,
                                                                   double frequency_hz) const noexcept;

  static constexpr int kStretches = 6;  ///< in a window

  OscillationMonitorOptions options_;
  double quantum_;       ///< [m]
  int stretch_ticks_;    ///< in a stretch
  double longest_step_;  ///< between ticks [s]

  bool begun_ = false;
  double delay_;  ///< [ticks]
  SentForces sent_;

  BandPass error_band_, force_band_;
  Vec3 error_ = Vec3::Zero();  ///< e through its band pass, at the previous tick [m]
  Sums current_;
  int ticks_ = 0;  ///< in current_
  std::array<Sums, kStretches> stretches_;
  int stretch_ = 0;     ///< the oldest of stretches_
  int complete_ = 0;    ///< of stretches_
  unsigned found_ = 0;  ///< which judgements found an oscillation, a bit each, the last one lowest
};

}  // namespace haptrace
