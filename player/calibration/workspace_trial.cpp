#include "player/calibration/workspace_trial.h"

#include "control/limits.h"
#include "control/path/min_jerk.h"
#include "control/ripple.h"
#include "devices/loop/servo_loop.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kSlow = 0.4;      // of the speed, at every second place
constexpr double kAtLimit = 0.98;  // share of the allowed force that counts as the limit
constexpr double kHand = 15;       // below it, the mass of a hand may swing on its grip after a movement [Hz]

/// Returns the tour as a path that lies within the workspace, also along axes that the device does not drive.
Path path_of(const DeviceInfo& info, const WorkspaceTour& tour) {
  constexpr double kStep = 2e-3;  // [s]
  Path path{.name = "the tour of the workspace"};
  const auto move = [&](double length, double speed, const auto& at) {
    const int steps = std::max(static_cast<int>(std::ceil(MinJerk::kPeakSpeed * length / speed / kStep)), 1);
    for (int i = path.time.empty() ? 0 : 1; i <= steps; ++i) {
      Vec3 position = at(MinJerk::at(static_cast<double>(i) / steps).s);
      for (int axis = 0; axis < 3; ++axis)
        if (!info.force_axes[static_cast<std::size_t>(axis)])
          position[axis] = std::clamp(tour.places.front()[axis], info.workspace_min[axis], info.workspace_max[axis]);
      path.time.push_back(path.time.empty() ? 0 : path.time.back() + kStep);
      path.position.push_back(position);
    }
  };
  const Vec3 side(tour.radius, 0, 0);
  for (std::size_t i = 0; i < tour.places.size(); ++i) {
    const Vec3& place = tour.places[i];
    if (i > 0) {
      const Vec3 from = path.position.back(), way = place + side - from;
      move(way.norm(), tour.speed, [&](double share) -> Vec3 { return from + share * way; });
    }
    move(kTurn * tour.radius, (i % 2 == 0 ? 1 : kSlow) * tour.speed, [&](double share) -> Vec3 {
      const double angle = kTurn * share;
      return place + tour.radius * Vec3(std::cos(angle), std::sin(angle), 0.5 * std::sin(2 * angle));
    });
  }
  return path;
}

/// Gathers error and ripple at each place while the reference is on its circle, and whether the force is at its limit
/// until it is on the next one. Counts oscillations, but not those of a loop that lacks force because the motors are
/// hot.
class PlaceFigures final : public SampleSink {
 public:
  PlaceFigures(const WorkspaceTour& tour, const SafetyLimits& limits)
      : places_(tour.places),
        reach_(1.2 * tour.radius),
        period_(1 / tour.session.loop.rate_hz),
        limiter_(limits),
        ripple_(kRippleCutoff, tour.session.loop.rate_hz),
        sums_(tour.places.size()) {
    if (const MotorHeat* const motors = tour.session.loop.motors) limiter_.warm(motors->force, motors->rested);
  }

  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    const double ripple = ripple_.update(sample.force);
    const bool limited = sample.force.norm() > kAtLimit * limiter_.allowed();
    limiter_.acted(sample.force, period_);
    if (sample.phase != Phase::run) return;
    force_ += sample.force.squaredNorm();
    for (std::size_t i = 0; i < places_.size(); ++i) {
      if (!((sample.reference_position - places_[i]).norm() < reach_)) continue;
      Sum& sum = sums_[at_ = i];
      sum.error += (sample.position - sample.reference_position).squaredNorm();
      sum.ripple += ripple;
      ++sum.ticks;
      break;
    }
    ++sums_[at_].all_ticks;
    sums_[at_].saturated += limited ? 1 : 0;
  }
  void push(const Event& event) noexcept override {
    const bool seen_in_position = event.code == EventCode::oscillation || event.code == EventCode::oscillation_stays;
    const bool of_hand = seen_in_position && event.values[1] < kHand;
    if (is_oscillation(event.code) && !of_hand && !(limiter_.heat() > 1)) ++oscillations_;
  }

  void write(TourResult& result) const {
    result.oscillations = oscillations_;
    int ticks = 0;
    for (const Sum& sum : sums_) {
      ticks += sum.all_ticks;
      result.rms_error.push_back(sum.ticks > 0 ? std::sqrt(sum.error / sum.ticks) : kNaN);
      result.ripple.push_back(sum.ticks > 0 ? std::sqrt(sum.ripple / sum.ticks) : kNaN);
      result.saturated.push_back(sum.ticks > 0 ? static_cast<double>(sum.saturated) / sum.all_ticks : 1);
    }
    result.force = ticks > 0 ? std::sqrt(force_ / ticks) : 0;
  }

 private:
  struct Sum {
    double error = 0, ripple = 0;
    int ticks = 0;  ///< on the circle
    int all_ticks = 0, saturated = 0;
  };

  std::vector<Vec3> places_;
  std::size_t at_ = 0;
  double reach_, period_;
  ForceLimiter limiter_;
  Ripple ripple_;
  std::vector<Sum> sums_;
  double force_ = 0;  ///< sum of squares [N^2]
  int oscillations_ = 0;
};

/// Largest error of a law over that of PD control at a single place. A law that follows the mass is softer than PD
/// control where the mass is small, and a tour is too short for it to learn the load there.
constexpr double kMostWorse = 1.3;

bool force_sufficed(const TourResult& law, const TourResult& plain, std::size_t place) {
  constexpr double kMostSaturated = 0.01;
  return law.saturated[place] <= kMostSaturated && plain.saturated[place] <= kMostSaturated;
}

}  // namespace

TourResult toured(Device& device, const PlayOptions& law, const WorkspaceTour& tour, const StopRequest& stop,
                  const Progress& progress) {
  PlayOptions options{.identified = law.identified,
                      .compensations = law.compensations,
                      .law = law.law,
                      .firmness = law.firmness,
                      .watch_release = false,  // on the way from place to place, loads turn as fast
                      .find_oscillations = tour.small_oscillations,
                      .smoothing = 0,
                      .session = tour.session};
  options.session.recording.reset();
  options.playback.max_deviation = tour.max_deviation;
  const DeviceInfo& info = device.info();
  PlaceFigures figures(tour, ServoLoop::in_force(info, tour.session.loop.limits));
  options.sinks = {&figures};
  PlayResult played = play(device, plan_playback(info, path_of(info, tour), options), options, stop, progress);
  TourResult result{.session = std::move(played.session)};
  figures.write(result);
  return result;
}

double least_improvement(const TourResult& law, const TourResult& plain) noexcept {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < law.rms_error.size(); ++i)
    if (force_sufficed(law, plain, i)) least = std::min(least, plain.rms_error[i] / law.rms_error[i]);
  return std::isfinite(least) ? least : 0;
}

double error_ratio(const TourResult& law, const TourResult& plain) noexcept {
  double own = 0, other = 0;  // sums of squares
  for (std::size_t i = 0; i < law.rms_error.size(); ++i) {
    if (!force_sufficed(law, plain, i)) continue;
    own += law.rms_error[i] * law.rms_error[i];
    other += plain.rms_error[i] * plain.rms_error[i];
  }
  return other > 0 ? std::sqrt(own / other) : 0;
}

double whole_error(const TourResult& toured) noexcept {
  double squares = 0;
  int places = 0;
  for (const double error : toured.rms_error) {
    if (std::isnan(error)) continue;
    squares += error * error;
    ++places;
  }
  return places > 0 ? std::sqrt(squares / places) : kNaN;
}

std::string refusal_of(const TourResult& law, const TourResult& plain, const WorkspaceTour& tour, double max_ripple) {
  if (!law.finished()) return "it ended early: " + law.session.servo.detail;
  if (law.oscillations > 0) return "it oscillates";
  for (std::size_t i = 0; i < law.rms_error.size(); ++i) {
    const double away = 1e3 * (tour.places[i] - tour.places.front()).norm();  // [mm]
    if (std::isnan(law.ripple[i])) return fmt::format("it did not reach the place {:.0f} mm from the centre", away);
    if (!(law.ripple[i] <= max_ripple))
      return fmt::format("its force ripple is {:.2f} N rms {:.0f} mm from the centre", law.ripple[i], away);
    if (!plain.finished() || !force_sufficed(law, plain, i)) continue;
    if (!(law.rms_error[i] <= kMostWorse * plain.rms_error[i]))
      return fmt::format("its error is {:.3f} mm {:.0f} mm from the centre, and that of plain PD control {:.3f} mm",
                         1e3 * law.rms_error[i], away, 1e3 * plain.rms_error[i]);
  }
  if (const double ratio = plain.finished() ? error_ratio(law, plain) : 0; ratio > 1)
    return fmt::format("its error is {:.2f} times that of plain PD control over the workspace", ratio);
  return "";
}

}  // namespace haptrace
