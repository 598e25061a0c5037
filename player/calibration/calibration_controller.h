// The controller that moves a device along the plan of a calibration.
#pragma once

#include "control/controller.h"
#include "control/pd.h"
#include "player/calibration/calibration_plan.h"
#include "player/calibration/first_look.h"
#include "player/playback/approach.h"

#include <cstddef>
#include <span>

namespace haptrace {

/// Drives the device along the plan.
///
/// Real-time: all but the constructors.
class CalibrationController final : public Controller {
 public:
  enum class Verdict { none, blocked, wrong_way, unclear, deviation };
  enum class Stage { approach, look, swing, sweep, pulse, travel, place, done };

  /// Borrows the plan.
  explicit CalibrationController(const CalibrationPlan& plan);

  /// For a device of about `mass` [kg], which sets the damping and bounds the movement to the acceleration that the
  /// force allows. The response of the first look is not judged again: its excitation hardly moves a heavy device.
  CalibrationController(const CalibrationPlan& plan, const Vec3& mass);

  void start(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;

  [[nodiscard]] Verdict verdict() const noexcept { return verdict_; }
  [[nodiscard]] Stage stage() const noexcept { return stage_; }
  [[nodiscard]] int axis() const noexcept { return axis_; }  ///< axis of the verdict or of the sweep

  /// Returns the amplitude that the look measured along the axis of the verdict [m].
  [[nodiscard]] double amplitude() const noexcept { return look_.amplitude(axis_); }

  /// Returns the index of the place that is visited; of its measurement during Stage::place.
  [[nodiscard]] std::size_t place() const noexcept { return place_; }

  /// Returns true while the samples belong to a measurement.
  [[nodiscard]] bool measures() const noexcept { return measures_; }

 private:
  [[nodiscard]] bool driven(int axis) const noexcept { return plan_.axes[static_cast<std::size_t>(axis)]; }

  [[nodiscard]] Vec3 driven_part(Vec3 v) const noexcept;
  void enter(Stage stage, double now) noexcept;
  void next_sweep(double now) noexcept;
  void next_pulses(double now) noexcept;
  [[nodiscard]] int next_driven(int axis) const noexcept;

  /// Ends the session with the pulses, unless they were tried. They come last: the monitor of vibrations may take the
  /// answer of the feedback to them for one, and soften it.
  void finish(double now) noexcept;

  /// Returns the force of the pulses `since` [s] after the strokes began [N].
  [[nodiscard]] double pulse(double since) const noexcept;
  [[nodiscard]] static double pulsed_time() noexcept;

  void travel_to(std::size_t place, double now) noexcept { travel_to(place, around_, now); }

  void travel_to(std::size_t place, Vec3 from, double now) noexcept;

  /// Leaves out a place where the hand does not go, and all that are left once that has happened often.
  void travel_on(const Vec3& position, double now) noexcept;

  [[nodiscard]] double place_time() const noexcept { return CalibrationPlan::kSettle + plan_.dither.period(); }

  void advance(const State& state, double now) noexcept;

  /// Returns the mass to be expected on the way to the next place and there, over that at the centre. The gains of the
  /// centre would make a much lighter device oscillate.
  [[nodiscard]] Vec3 expected_mass() const noexcept { return place_ < plan_.nearer_places ? Vec3::Ones() : lightest_; }

  /// Notes how light the device was at a place. It is taken to become lighter beyond the nearer places as it did before
  /// them.
  void weigh() noexcept;

  [[nodiscard]] double swing_time() const noexcept { return plan_.dither_windows() * plan_.dither.period(); }
  [[nodiscard]] double sweep_time() const noexcept;

  /// Judges the first look: checks that the device follows the force, then sets gains and excitation from its mass and
  /// lag.
  void judge(double now) noexcept;
  void begin_swing(double now, const Vec3& dither) noexcept;
  void stop(Verdict verdict, int axis) noexcept;

  /// Returns the reference `since` [s] after the stage began. Look and swing are one movement.
  [[nodiscard]] Reference reference(double since) const noexcept;

  static constexpr double kShortestPulse = 8e-3, kLongestPulse = 20e-3;  ///< [s]

  const CalibrationPlan& plan_;
  FirstLook look_, before_, there_;  ///< the current look, an earlier inconclusive one, and one at a place
  std::span<const double> sizes_;
  PdGains gains_, centre_gains_;
  Vec3 lightest_ = Vec3::Ones();  ///< smallest mass to be expected at a farther place, over that at the centre
  double swing_size_;
  Vec3 sweep_size_;

  Stage stage_ = Stage::approach;
  Verdict verdict_ = Verdict::none;
  int axis_ = 0;
  bool measures_ = false, stronger_ = false, gentle_ = false;
  Vec3 home_ = Vec3::Zero();
  Vec3 around_ = Vec3::Zero();  ///< centre of the movement
  std::size_t place_ = 0;
  bool pulsed_ = false;                                  ///< the pulses began
  int left_out_ = 0;                                     ///< places
  double pulse_force_ = 0, pulse_time_ = kLongestPulse;  ///< largest pulse of an axis [N], and its duration [s]
  Approach approach_, travel_;
  double began_ = 0, look_begin_ = CalibrationPlan::kSettle, swing_begin_ = 0;
  Vec3 dither_ = Vec3::Zero(), dither_wanted_ = Vec3::Zero();  ///< rms per axis [N]
  Vec3 dither_measured_ = Vec3::Zero();                        ///< of the measurements
};

}  // namespace haptrace
