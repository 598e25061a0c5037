#include "player/calibration/calibration_controller.h"

#include "control/norm.h"
#include "control/path/min_jerk.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace haptrace {
namespace {

constexpr int kMostLeftOut = 2;      // number of places from which a hand may keep the device
constexpr double kLetGo = 0.5;       // share of the largest deviation at which a hand keeps the device from a place
constexpr double kPlaceGains = 0.7;  // of the gains for the mass at a place, which is known only roughly
constexpr double kLightest = 0.2;    // share of the mass at the centre down to which the gains follow it
// Share of the excitation at the centre that is left for a light device. Its friction is not smaller.
constexpr double kLeastDither = 0.4;
constexpr double kLookDither = 0.08;   // share of the largest force, rms per axis
constexpr double kDitherSpeed = 0.25;  // rms velocity from the excitation, as a share of the sweeps' peak speed
constexpr double kLeastMotion = 0.25;  // share of the requested speed below which a device counts as blocked

// Constants of a second, gentler session. It runs when the excitation of the first one did not move the device enough
// although the device moves in the direction of the force.
constexpr double kGentleBandwidth = 25;  // bandwidth of the gains, low enough for any delay of a few samples [rad/s]

// Pulses: strokes along an axis under an alternating force of rising size. The pulses change the speed by as much as
// the stroke has, so that the movement, and with it the friction, hardly ever reverses during a stroke.
constexpr double kPulseForce = 0.7;   // share of the permitted force
constexpr double kPulseSpeed = 0.5;   // share of the sweeps' peak speed
constexpr double kPulseGains = 0.35;  // of the gains at the centre: the feedback hardly answers the pulses

/// A triangle of period 1 and height 1 with rounded corners, and its slope.
struct RoundedTriangle {
  double value, slope;

  static RoundedTriangle at(double turns) noexcept {
    constexpr double kSharpness = 0.97;
    const double height = std::asin(kSharpness), s = kSharpness * std::sin(kTwoPi * turns);
    return {std::asin(s) / height, kTwoPi * kSharpness * std::cos(kTwoPi * turns) / (std::sqrt(1 - s * s) * height)};
  }
};

}  // namespace

CalibrationController::CalibrationController(const CalibrationPlan& plan)
    : plan_(plan),
      look_(plan),
      before_(plan),
      there_(plan),
      sizes_(plan.sweep_sizes()),
      gains_(cautious_gains(std::min(plan.device_force, CalibrationPlan::kLargestForce), plan.rate_hz)),
      swing_size_(plan.swing_size()),
      sweep_size_(plan.reach.cwiseMin(plan.max_speed / (4 * CalibrationPlan::kSweepHz))) {}

CalibrationController::CalibrationController(const CalibrationPlan& plan, const Vec3& mass)
    : CalibrationController(plan) {
  gentle_ = true;
  gains_ = {gains_.kp.cwiseMax(kGentleBandwidth * kGentleBandwidth * mass),
            (2 * gains_.kd).cwiseMax(1.4 * kGentleBandwidth * mass)};
  const double acceleration = CalibrationPlan::kInertiaShare * plan.max_force / mass.maxCoeff();  // [m/s^2]
  // Peak acceleration of the swing, including its vertical movement at twice the frequency, and of a triangle's first
  // harmonic.
  swing_size_ = std::min(swing_size_, acceleration / (std::sqrt(5.0) * std::pow(kTwoPi * plan.swing_hz(), 2)));
  sweep_size_ = sweep_size_.cwiseMin(acceleration / (0.81 * std::pow(kTwoPi * CalibrationPlan::kSweepHz, 2)));
}

void CalibrationController::start(const State& first) noexcept {
  home_ = plan_.centre;
  for (int axis = 0; axis < 3; ++axis)
    if (!driven(axis)) home_[axis] = first.position[axis];
  around_ = home_;
  approach_ = Approach(first.position, home_, plan_.approach_speed, CalibrationPlan::kShortestApproach);
}

Command CalibrationController::update(const State& state) noexcept {
  const double now = 1e-9 * static_cast<double>(state.time_ns);
  advance(state, now);
  if ((stage_ == Stage::travel || stage_ == Stage::place) && place_ < plan_.places.size() &&
      driven_part(this->reference(now - began_).position - state.position).norm() > kLetGo * plan_.max_deviation)
    travel_on(state.position, now);
  if (stage_ == Stage::pulse &&
      driven_part(this->reference(now - began_).position - state.position).norm() > kLetGo * plan_.max_deviation)
    travel_to(plan_.places.size(), home_ + driven_part(state.position - home_), now);
  const Reference reference = this->reference(now - began_);
  dither_ += std::clamp(state.dt / CalibrationPlan::kBlend, 0.0, 1.0) * (dither_wanted_ - dither_);

  Command command;
  command.reference = reference;
  command.phase = stage_ == Stage::approach ? Phase::approach : stage_ == Stage::done ? Phase::hold : Phase::run;
  Vec3 excitation = Vec3::Zero();
  if (stage_ == Stage::look || stage_ == Stage::swing || stage_ == Stage::place)
    excitation = dither_.cwiseProduct(plan_.dither.value(now));
  if (stage_ == Stage::pulse) excitation[axis_] = pulse(now - began_);
  if (const double size = excitation.norm(); size > plan_.max_force) excitation *= plan_.max_force / size;
  Vec3 pull = driven_part(pd_force(gains_, state, reference));
  if (stage_ == Stage::pulse) {
    // Both pulses of a pair together leave the feedback its force, which the weight of the device needs.
    pull = shortened(pull + excitation, plan_.max_force) - excitation;
  } else {
    pull = shortened(pull, std::max(plan_.max_force - excitation.norm(), 0.0));
  }
  command.wrench.force = pull + excitation;
  command.feedforward = excitation;

  const double deviation = driven_part(reference.position - state.position).norm();
  if (deviation > plan_.max_deviation && verdict_ == Verdict::none) {
    verdict_ = Verdict::deviation;
    command.event = Event{.code = EventCode::deviation_limit, .values = {deviation, plan_.max_deviation, kNaN}};
  }
  if (verdict_ != Verdict::none)
    command.status = Command::Status::deviation;
  else if (stage_ == Stage::done && now - began_ > CalibrationPlan::kBlend)
    command.status = Command::Status::finished;
  return command;
}

Vec3 CalibrationController::driven_part(Vec3 v) const noexcept {
  for (int axis = 0; axis < 3; ++axis)
    if (!driven(axis)) v[axis] = 0;
  return v;
}

void CalibrationController::enter(Stage stage, double now) noexcept {
  stage_ = stage;
  began_ = now;
  measures_ = false;
}

void CalibrationController::next_sweep(double now) noexcept {
  const int axis = next_driven(stage_ == Stage::sweep ? axis_ + 1 : 0);
  if (axis < 3) {
    enter(Stage::sweep, now);
    axis_ = axis;
  } else {
    centre_gains_ = gains_;
    travel_to(0, now);
  }
}

void CalibrationController::next_pulses(double now) noexcept {
  const int axis = next_driven(stage_ == Stage::pulse ? axis_ + 1 : 0);
  if (axis >= 3) return enter(Stage::done, now);
  gains_ = {kPulseGains * centre_gains_.kp, kPulseGains * centre_gains_.kd};
  enter(Stage::pulse, now);
  axis_ = axis;
  pulsed_ = true;
  // A pulse turns the speed of the movement by twice the share that the pulses have.
  const double turn = 2 * kPulseSpeed * plan_.max_speed * std::max(look_.mass(axis), 1e-3);  // [N s]
  const double force = kPulseForce * plan_.max_force;
  pulse_time_ = std::clamp(turn / force, kShortestPulse, kLongestPulse);
  pulse_force_ = std::min(force, turn / pulse_time_);
}

int CalibrationController::next_driven(int axis) const noexcept {
  while (axis < 3 && !driven(axis)) ++axis;
  return axis;
}

void CalibrationController::finish(double now) noexcept {
  if (plan_.pulses && !pulsed_)
    next_pulses(now);
  else
    enter(Stage::done, now);
}

double CalibrationController::pulse(double since) const noexcept {
  const double turns = since * CalibrationPlan::kPulsedHz - CalibrationPlan::kSweepLead;
  if (turns < 0) return 0;
  const auto cycle = std::min(static_cast<std::size_t>(turns), CalibrationPlan::kPulseSizes.size() - 1);
  const double phase =
      std::fmod(turns / CalibrationPlan::kPulsedHz / pulse_time_ + 0.5, 2.0);  // the first pulse is half a one
  return (phase < 1 ? pulse_force_ : -pulse_force_) * CalibrationPlan::kPulseSizes[cycle];
}

double CalibrationController::pulsed_time() noexcept {
  return (CalibrationPlan::kSweepLead + static_cast<double>(CalibrationPlan::kPulseSizes.size())) /
         CalibrationPlan::kPulsedHz;
}

void CalibrationController::travel_to(std::size_t place, Vec3 from, double now) noexcept {
  place_ = place;
  const Vec3 share = kPlaceGains * expected_mass();
  gains_ = {share.cwiseProduct(centre_gains_.kp), share.cwiseProduct(centre_gains_.kd)};
  const bool another = place < plan_.places.size();
  around_ = another ? home_ + driven_part(plan_.places[place] - home_) : home_;
  travel_ = Approach(from, around_, plan_.approach_speed, CalibrationPlan::kShortestApproach);
  if (another || from != around_)
    enter(Stage::travel, now);
  else
    finish(now);
}

void CalibrationController::travel_on(const Vec3& position, double now) noexcept {
  dither_wanted_ = Vec3::Zero();
  travel_to(++left_out_ > kMostLeftOut ? plan_.places.size() : place_ + 1, home_ + driven_part(position - home_), now);
}

void CalibrationController::advance(const State& state, double now) noexcept {
  const double since = now - began_;
  switch (stage_) {
    case Stage::approach:
      if (since < approach_.duration() + CalibrationPlan::kBlend) break;
      enter(Stage::look, now);
      dither_wanted_ = driven_part(Vec3::Constant(kLookDither / CalibrationPlan::kMostDither * plan_.max_dither));
      break;
    case Stage::look:
      if (since >= look_begin_ && since < look_begin_ + CalibrationPlan::kLook)
        look_.add(state, now, (since - look_begin_) / CalibrationPlan::kLook, reference(since).velocity,
                  plan_.dither.value(now));
      else if (since >= look_begin_ + CalibrationPlan::kLook)
        judge(now);
      break;
    case Stage::swing:
      // The reference continues where the look left it.
      measures_ = since >= swing_begin_ && since < swing_begin_ + swing_time();
      if (since >= swing_begin_ + swing_time()) dither_wanted_ = Vec3::Zero();
      if (since >= swing_begin_ + swing_time() + CalibrationPlan::kBlend) next_sweep(now);
      break;
    case Stage::sweep:
      measures_ = since >= CalibrationPlan::kSweepLead / CalibrationPlan::kSweepHz && since < sweep_time();
      if (since >= sweep_time()) next_sweep(now);
      break;
    case Stage::pulse:
      measures_ = since >= CalibrationPlan::kSweepLead / CalibrationPlan::kPulsedHz && since < pulsed_time();
      if (since >= pulsed_time()) next_pulses(now);
      break;
    case Stage::travel:
      if (since < travel_.duration()) break;
      if (place_ >= plan_.places.size()) {
        finish(now);
      } else {
        enter(Stage::place, now);
        there_.reset();
        dither_wanted_ = dither_measured_.cwiseProduct(expected_mass().cwiseMax(kLeastDither));
      }
      break;
    case Stage::place:
      measures_ = since >= CalibrationPlan::kSettle && since < place_time();
      if (measures_)
        there_.add(state, now, (since - CalibrationPlan::kSettle) / plan_.dither.period(), reference(since).velocity,
                   plan_.dither.value(now));
      if (since >= place_time()) dither_wanted_ = Vec3::Zero();
      if (since >= place_time() + CalibrationPlan::kBlend) {
        weigh();
        travel_to(place_ + 1, now);
      }
      break;
    case Stage::done:
      break;
  }
}

void CalibrationController::weigh() noexcept {
  const bool near = place_ < plan_.nearer_places;
  for (int axis = 0; axis < 3; ++axis) {
    if (!driven(axis)) continue;
    const double share = there_.mass(axis) / look_.mass(axis), expected = near ? 2 * share - 1 : share;
    lightest_[axis] = std::clamp(expected, kLightest, lightest_[axis]);
  }
}

double CalibrationController::sweep_time() const noexcept {
  return (CalibrationPlan::kSweepLead + static_cast<double>(sizes_.size())) / CalibrationPlan::kSweepHz;
}

void CalibrationController::judge(double now) noexcept {
  if (gentle_) return begin_swing(now, driven_part(Vec3::Constant(plan_.max_dither)));
  Vec3 dither = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    if (!driven(axis)) continue;
    const bool moves = look_.motion(axis) >= kLeastMotion;
    if (!moves || !(look_.follows(axis) || (stronger_ && look_.obeys(axis)))) {
      if (stronger_)
        return stop(!moves                         ? Verdict::blocked
                    : look_.repeats(before_, axis) ? Verdict::wrong_way
                                                   : Verdict::unclear,
                    axis);
      // Look once more, with twice the stiffness.
      stronger_ = true;
      gains_.kp *= 2;
      gains_.kd *= 1.5;
      before_ = look_;
      look_.reset();
      look_begin_ += CalibrationPlan::kLook + CalibrationPlan::kSettle;
      return;
    }
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (!driven(axis)) continue;
    const double mass = look_.mass(axis);
    // The gains are stiff enough that the device follows the sweep instead of the direction of least friction.
    constexpr double kStiffest = kTwoPi * 12;  // [rad/s]
    constexpr double kFilterLag = 2.5e-3;      // delay of a usual velocity estimate [s]
    const double bandwidth = std::min(kStiffest, 0.45 / (look_.lag(axis) + kFilterLag));
    gains_.kp[axis] = std::max(gains_.kp[axis], mass * bandwidth * bandwidth);
    gains_.kd[axis] = std::max(gains_.kd[axis], 1.2 * mass * bandwidth);

    double response = 0;  // mean square speed of 1 kg under an excitation of 1 N rms
    for (const SpectralLine& line : plan_.dither.lines(axis))
      response += 0.5 * std::pow(line.amplitude / (kTwoPi * line.frequency_hz), 2);
    dither[axis] = std::clamp(kDitherSpeed * plan_.max_speed * mass / std::sqrt(response),
                              std::min(0.02 * plan_.device_force, plan_.max_dither), plan_.max_dither);
  }
  begin_swing(now, dither);
}

void CalibrationController::begin_swing(double now, const Vec3& dither) noexcept {
  dither_wanted_ = dither_measured_ = dither;
  swing_begin_ = now - began_ + CalibrationPlan::kSettle;
  stage_ = Stage::swing;
}

void CalibrationController::stop(Verdict verdict, int axis) noexcept {
  verdict_ = verdict;
  axis_ = axis;
}

Reference CalibrationController::reference(double since) const noexcept {
  Reference r{.position = around_, .velocity = Vec3::Zero(), .acceleration = nan3()};
  switch (stage_) {
    case Stage::approach:
      return approach_.at(since);
    case Stage::travel:
      return travel_.at(since);
    case Stage::look:
    case Stage::swing:
    case Stage::place: {
      // Circle in x and y, with two vertical cycles per turn: no direction rests for long.
      const double w = kTwoPi * plan_.swing_hz(), angle = w * since;
      const Vec3 place(std::cos(angle), std::sin(angle), 0.5 * std::sin(2 * angle));
      const Vec3 slope(-std::sin(angle), std::cos(angle), std::cos(2 * angle));
      const MinJerk in = MinJerk::at(since / CalibrationPlan::kBlend);
      double size = in.s, growth = in.ds / CalibrationPlan::kBlend;
      if (stage_ != Stage::look) {
        const double end = stage_ == Stage::swing ? swing_begin_ + swing_time() : place_time();
        const MinJerk out = MinJerk::at((since - end) / CalibrationPlan::kBlend);
        growth = growth * (1 - out.s) - size * out.ds / CalibrationPlan::kBlend;
        size *= 1 - out.s;
      }
      r.position += driven_part(swing_size_ * size * place);
      r.velocity = driven_part(swing_size_ * (size * w * slope + growth * place));
      break;
    }
    case Stage::sweep: {
      const double turns = since * CalibrationPlan::kSweepHz;
      const auto cycle = static_cast<std::ptrdiff_t>(std::floor(turns - CalibrationPlan::kSweepLead));
      const double size =
          sizes_[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(cycle, 0, std::ssize(sizes_) - 1))];
      const RoundedTriangle triangle = RoundedTriangle::at(turns);
      r.position[axis_] += sweep_size_[axis_] * size * triangle.value;
      r.velocity[axis_] = sweep_size_[axis_] * size * CalibrationPlan::kSweepHz * triangle.slope;
      break;
    }
    case Stage::pulse: {
      const RoundedTriangle triangle = RoundedTriangle::at(since * CalibrationPlan::kPulsedHz);
      const double size =
          std::min(kPulseSpeed * plan_.max_speed / (4 * CalibrationPlan::kPulsedHz), plan_.reach[axis_]);
      r.position[axis_] += size * triangle.value;
      r.velocity[axis_] = size * CalibrationPlan::kPulsedHz * triangle.slope;
      break;
    }
    case Stage::done:
      break;
  }
  return r;
}

}  // namespace haptrace
