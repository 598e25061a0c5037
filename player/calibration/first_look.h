// Response of a device at a few lines of an excitation signal, while a session runs.
#pragma once

#include "control/controller.h"
#include "player/calibration/calibration_plan.h"

#include <array>
#include <complex>

namespace haptrace {

/// Response of the device at a few lines of the excitation signal, computed during the session with a Hann window.
///
/// Real-time: all but the constructor.
class FirstLook {
 public:
  explicit FirstLook(const CalibrationPlan& plan);

  void reset() noexcept;

  /// Adds one sample. `share`: part of the window that has passed at `time`, 0 to 1. `excitation`: signal at `time`
  /// for 1 N rms per axis.
  void add(const State& state, double time, double share, const Vec3& speed_asked, const Vec3& excitation) noexcept;

  /// Returns the apparent mass, the median over the lines [kg].
  [[nodiscard]] double mass(int axis) const noexcept;

  /// Returns the lag of the response behind that of a mass, the median over the lines [s]. The damping of a hand makes
  /// it appear slightly larger.
  [[nodiscard]] double lag(int axis) const noexcept;

  /// Returns true when a force along `axis` moves the device in that direction. At these frequencies a mass moves
  /// against the force, late by a delay that is not known yet; the response is therefore compared with that of a mass
  /// of either sign at every delay. A hand that is stiff for the device's mass, or a link that swings, also responds
  /// like a mass of the wrong sign.
  [[nodiscard]] bool follows(int axis) const noexcept;

  /// Returns true when the device goes with its reference under feedback. That shows the direction of the force where
  /// the excitation does not: a link that swings, or a hand that is stiff for the device's mass, turns the response at
  /// the lines, but not that to the slow movement. Feedback of the wrong sign drives the device the other way.
  [[nodiscard]] bool obeys(int axis) const noexcept;

  /// Returns true when the responses to the excitation along `axis` match those in `other`, an earlier look. The
  /// response of a device repeats, whatever its axes; movement from a hand's tremor or from encoder steps does not. The
  /// responses are compared with the excitation and not with the force: feedback turns part of every movement into
  /// force.
  [[nodiscard]] bool repeats(const FirstLook& other, int axis) const noexcept;

  /// Returns the amplitude of the movement along `axis`, the median over the lines [m].
  [[nodiscard]] double amplitude(int axis) const noexcept;

  /// Returns the mean speed divided by the mean requested speed.
  [[nodiscard]] double motion(int axis) const noexcept { return asked_[axis] > 0 ? speed_[axis] / asked_[axis] : 1; }

 private:
  static constexpr int kLines = 3;
  static constexpr std::array<double, kLines> kWanted{19, 29, 43};  // [Hz]

  struct Sum {
    double w = 0;
    std::complex<double> force{}, excitation{};
    std::array<std::complex<double>, 3> position{};
  };

  std::array<bool, 3> axes_;
  std::array<std::array<Sum, kLines>, 3> sums_;
  Vec3 speed_ = Vec3::Zero(), asked_ = Vec3::Zero();
  Vec3 along_ = Vec3::Zero(), squares_ = Vec3::Zero();  ///< products of speed and requested speed
  double windows_ = 0;
};

}  // namespace haptrace
