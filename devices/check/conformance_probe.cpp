#include "devices/check/conformance_probe.h"

#include "devices/loop/clock.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <chrono>
#include <thread>

namespace haptrace {
namespace {

constexpr double kProbeSlew = 0.02;         // time in which a probe reaches its largest force [s]
constexpr double kNoStep = 1e-9;            // positions closer than this are equal [m]
constexpr double kProbeWindow = 0.05;       // longest window on each side of a reversal [s]
constexpr double kProbeFit = 0.05;          // largest rms residual of a fit, over the motion
constexpr double kLongestProbeDelay = 0.1;  // longest delay of the search [s]
constexpr double kProbeDelayStep = 5e-4;    // [s]

double time_of(const State& state) {
  return 1e-9 * static_cast<double>(state.time_ns);
}

double half_square(double t) {
  return t > 0 ? 0.5 * t * t : 0;
}

}  // namespace

void ObservedDevice::observe(std::size_t exchanges) {
  rows_.clear();
  rows_.reserve(exchanges);
  time_ = 0;
}

Device::Status ObservedDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  const std::int64_t begin_ns = monotonic_ns();
  pulse_.at(TickPulse::Place::device);
  const Status status = device_->exchange(spoilt_ && dt > 0 ? Wrench{nan3(), nan3()} : wrench, dt, state);
  pulse_.at(TickPulse::Place::outside);
  const std::int64_t end_ns = monotonic_ns();
  if (status != Status::ok) return status;
  exchange_time_.record(end_ns - begin_ns);
  if (!state.ready && rows_.empty()) return status;
  if (dt == 0) {
    // Either the first tick, after the wait for readiness, or the zero force at the end.
    if (rows_.size() > 1) return status;
    rows_.clear();
    time_ = 0;
  }
  time_ += dt;
  if (rows_.size() < rows_.capacity())
    rows_.push_back(
        {time_, dt, end_ns - static_cast<std::int64_t>(1e9 * std::clamp(state.age, 0.0, 1e6)), wrench.force, state});
  return status;
}

Command RestController::update(const State& state) noexcept {
  const double t = time_of(state);
  if (device_ != nullptr) device_->spoil(t >= spoil_at_ && t < spoil_at_ + kSpoilt);
  Command command;
  if (t >= duration_) command.status = Command::Status::finished;
  return command;
}

Command ProbeController::update(const State& state) noexcept {
  farthest_ = std::max(farthest_, (state.position - start_).norm());
  const bool outside = (state.position.array() < workspace_min_.array()).any() ||
                       (state.position.array() > workspace_max_.array()).any();
  too_far_ = too_far_ || outside || farthest_ > kTooFar;
  const std::optional<Vec3> next = too_far_ ? std::nullopt : wanted(state);
  const double largest = max_force_ / kProbeSlew * state.dt;
  const Vec3 change = next.value_or(Vec3::Zero()) - force_;
  const double size = change.norm();
  force_ += size > largest ? Vec3(change * (largest / size)) : change;

  Command command;
  command.wrench.force = force_;
  if (!next) command.status = Command::Status::finished;
  return command;
}

std::optional<Vec3> PushController::wanted(const State& state) noexcept {
  const double t = time_of(state), sign = stroke_ == 0 ? 1 : -1;
  if (stage_ == Stage::rest) {
    if (t - since_ < kLead) return Vec3::Zero();
    if (stroke_ == strokes_.size()) return std::nullopt;
    stage_ = Stage::grow;
    strokes_[stroke_].begin = since_ = t;
    seen_at_ = kNaN;
    from_ = state.position;
  }
  Stroke& stroke = strokes_[stroke_];
  if (stage_ == Stage::grow) {
    const Vec3 path = state.position - from_;
    if (std::isnan(seen_at_) && path.norm() > least_motion_) {
      seen_at_ = t;
      seen_ = path.norm();
    }
    stroke.reached = path.norm() >= kReach;
    if (!stroke.reached && t - stroke.begin < longest()) return sign * grown(t - stroke.begin) * Vec3::Unit(axis_);
    turn(path, t);
  }
  const double braked = t - stroke.turned, moving = stroke.turned - stroke.moves;
  if (stroke.reached && braked < moving && state.velocity.dot(stroke.path) > 0)
    return -sign * grown(stroke.turned - stroke.begin - braked) * Vec3::Unit(axis_);
  stroke.stopped = since_ = t;
  stage_ = Stage::rest;
  ++stroke_;
  return Vec3::Zero();
}

void PushController::turn(const Vec3& path, double now) noexcept {
  Stroke& stroke = strokes_[stroke_];
  stroke.turned = now;
  stroke.path = path;
  stroke.moves = onset(path.norm(), now);
  stage_ = Stage::brake;
}

/// A mass under a linearly growing force moves with the cube of the time since its start.
double PushController::onset(double way, double now) const noexcept {
  const double begin = strokes_[stroke_].begin;
  if (std::isnan(seen_at_) || !(way > seen_)) return begin;
  const double ratio = std::cbrt(way / seen_);
  return std::max((ratio * seen_at_ - now) / (ratio - 1), begin);
}

std::optional<Vec3> HoldController::wanted(const State& state) noexcept {
  const double t = time_of(state);
  if (t < kLead) return Vec3::Zero();
  // Wait a little longer, so that the full force is sent before the measurement.
  if (t < kLead + 1.2 * kProbeSlew) return hold_;
  if (std::isnan(full_since_)) {
    full_since_ = t;
    from_ = state.position;
  }
  if (std::isnan(turned_)) {
    const double path = (state.position - from_).dot(hold_.normalized());
    if (t - full_since_ < seconds_ && path < kFar) return hold_;
    turned_ = t;
    path_ = path;
  }
  if (std::isnan(stopped_)) {
    if (t < turned_ + held() && state.velocity.dot(hold_) > 0) return -hold_;
    stopped_ = t;
  }
  if (t < stopped_ + kLead) return Vec3::Zero();
  return std::nullopt;
}

void HoldController::between_ticks(bool /*may_wait*/) noexcept {
  if (host_ == Host::pauses && !std::isnan(full_since_) && std::isnan(turned_))
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds_));
}

std::optional<Vec3> SpringController::wanted(const State& state) noexcept {
  if (time_of(state) >= duration_) return std::nullopt;
  const Vec3 force = kStiffness * (start_ - state.position) - kDamping * state.velocity;
  const double size = force.norm();
  return size > max_force_ ? Vec3(force * (max_force_ / size)) : force;
}

Vec3 response(const std::array<Stroke, 2>& strokes) noexcept {
  return 0.5 * (strokes[0].path - strokes[1].path);
}

double latency_of(std::span<const Exchanged> rows, const Stroke& stroke, int axis, bool virtual_time) {
  if (!stroke.reached) return kNaN;
  const double half = std::min(0.6 * (stroke.turned - stroke.moves), kProbeWindow);
  const auto row_at = [&](double time) {
    return std::lower_bound(rows.begin(), rows.end(), time,
                            [](const Exchanged& row, double t) { return row.time < t; });
  };
  const auto pushed = row_at(stroke.begin), begin = row_at(stroke.turned - half),
             end = row_at(std::min(stroke.turned + half, stroke.stopped));
  if (end - begin < 8) return kNaN;

  // The double integral at `time`. In virtual time a force acts during its exchange, else from its exchange to the
  // next.
  const auto integral = [&](double time) {
    double sum = 0;
    for (auto row = pushed; row + 1 != rows.end() && row->time - row->dt <= time; ++row) {
      const double from = virtual_time ? row->time - row->dt : row->time,
                   to = virtual_time ? row->time : (row + 1)->time;
      sum += row->force[axis] * (half_square(time - from) - half_square(time - to));
    }
    return sum;
  };
  double best = kNaN, least = std::numeric_limits<double>::infinity(), range = 0;
  for (double delay = 0; delay <= kLongestProbeDelay; delay += kProbeDelayStep) {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d moment = Eigen::Vector4d::Zero();
    double square = 0;
    for (auto row = begin; row != end; ++row) {
      const double u = (row->time - stroke.turned) / half, x = row->state.position[axis] - begin->state.position[axis];
      const Eigen::Vector4d terms(1, u, u * u, integral(row->time - delay) / (half * half));
      normal += terms * terms.transpose();
      moment += terms * x;
      square += x * x;
      range = std::max(range, std::abs(x));
    }
    const Eigen::Vector4d fit = normal.ldlt().solve(moment);
    const double residual = (square - fit.dot(moment)) / static_cast<double>(end - begin);
    if (!(residual < least) || fit[3] <= 0) continue;
    least = residual;
    best = delay;
  }
  // A handle that a stiff hand holds, or that waits for friction, does not follow the integral of the force. Then no
  // delay fits, and the best one is mostly the largest.
  const bool fits = best + kProbeDelayStep < kLongestProbeDelay && std::sqrt(std::max(least, 0.0)) < kProbeFit * range;
  return fits ? best : kNaN;
}

void SmallestStep::add(std::span<const Exchanged> rows) noexcept {
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const double step = (rows[k].state.position - rows[k - 1].state.position).norm();
    if (!(step > kNoStep)) continue;
    distance = steps == 0 ? step : std::min(distance, step);
    ++steps;
  }
}

double noise_of(std::span<const Exchanged> rows) noexcept {
  if (rows.size() < 3) return 0;
  double sum = 0;
  for (std::size_t k = 2; k < rows.size(); ++k)
    sum += (rows[k].state.position - 2 * rows[k - 1].state.position + rows[k - 2].state.position).squaredNorm();
  // White noise of variance s^2 has second differences of variance 6 s^2, in each of three axes.
  return std::sqrt(sum / (18 * static_cast<double>(rows.size() - 2)));
}

}  // namespace haptrace
