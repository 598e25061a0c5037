#include "formats/path/expert_force.h"

#include "base/error.h"
#include "control/zero_phase.h"
#include "formats/path/path_blocks.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace haptrace {
namespace {

constexpr double kMargin = 0.4;  // beyond both ends of a piece, about thirty time constants of the low pass [s]
constexpr double kFinestStep = 5e-4, kCoarsestStep = 2e-3;  // of the even grid [s]

/// Interpolates `values` at `stamps` (increasing) linearly at `time`, which must not decrease from call to call.
class Interpolator {
 public:
  Interpolator(const std::vector<double>& stamps, const std::vector<Vec3>& values) : stamps_(stamps), values_(values) {}

  [[nodiscard]] Vec3 at(double time) {
    while (i_ + 2 < stamps_.size() && stamps_[i_ + 1] <= time) ++i_;
    const double share = (time - stamps_[i_]) / (stamps_[i_ + 1] - stamps_[i_]);
    return values_[i_] + std::clamp(share, 0.0, 1.0) * (values_[i_ + 1] - values_[i_]);
  }

 private:
  const std::vector<double>& stamps_;
  const std::vector<Vec3>& values_;
  std::size_t i_ = 0;
};

/// Velocity over which the sign of the friction changes [m/s]. Smaller than in FrictionFeedforward: the velocity is
/// known beyond its noise, because it is low-passed without lag, and nothing is fed back.
constexpr double kTransition = 2e-3;

/// Returns the friction b v + R^T F_c tanh(R v / v_0) of a device that moves at `v` [m/s].
Vec3 friction_at(const PlantModel& plant, const Vec3& v) {
  const Eigen::Matrix3d axes = plant.actuators ? plant.actuators->axes : Eigen::Matrix3d::Identity();
  const Vec3 signs = (axes * v / kTransition).array().tanh();
  const Vec3& coulomb = plant.actuators ? plant.actuators->coulomb : plant.coulomb;
  return plant.viscous.cwiseProduct(v) + axes.transpose() * coulomb.cwiseProduct(signs);
}

/// Adds to `force` [N] what the device took from it while it moved through `x` [m]. Both are low-passed, every `h` [s].
void add_device(const HandleForce& handle, const std::vector<Vec3>& x, double h, std::vector<Vec3>& force) {
  const PlantModel& plant = handle.plant;
  const std::size_t n = x.size();
  std::vector<Vec3> dry(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3 &before = x[i - std::min<std::size_t>(i, 1)], &after = x[std::min(i + 1, n - 1)];
    const double span = i == 0 || i + 1 == n ? h : 2 * h;
    dry[i] = friction_at(plant, (after - before) / span);
    if (plant.cogging) dry[i] -= plant.cogging->force(x[i]);
    if (i == 0 || i + 1 == n) continue;
    Vec3 mass = plant.mass;
    if (handle.inertia) mass = handle.inertia->at(x[i]).cwiseProduct(mass);
    force[i] += mass.cwiseProduct(after - 2 * x[i] + before) / (h * h);
  }
  zero_phase_low_pass(dry, kExpertForceCutoff, 1 / h);
  for (std::size_t i = 0; i < n; ++i) force[i] += dry[i] - plant.gravity - plant.gravity_gradient * x[i];
}

/// Returns the force of the task at every row of `rows`.
std::vector<Vec3> task_of(const Path& rows, const HandleForce& handle, double h) {
  std::vector<Vec3> measured = rows.force;
  if (handle.negated)
    for (Vec3& force : measured) force = -force;
  if (rows.size() < 2) return measured;
  const double begin = rows.time.front();
  const auto points = static_cast<std::size_t>(rows.duration() / h) + 2;
  std::vector<double> time;
  std::vector<Vec3> x, force;
  Interpolator positions(rows.time, rows.position), forces(rows.time, measured);
  for (std::size_t i = 0; i < points; ++i) {
    time.push_back(begin + static_cast<double>(i) * h);
    x.push_back(positions.at(time.back()));
    force.push_back(forces.at(time.back()));
  }
  zero_phase_low_pass(x, kExpertForceCutoff, 1 / h);
  zero_phase_low_pass(force, kExpertForceCutoff, 1 / h);
  add_device(handle, x, h, force);
  std::vector<Vec3> result;
  Interpolator task(time, force);
  for (const double stamp : rows.time) result.push_back(task.at(stamp));
  return result;
}

class TaskForcePath final : public PathSource {
 public:
  TaskForcePath(std::shared_ptr<const PathSource> path, const HandleForce& handle)
      : path_(std::move(path)), handle_(handle) {
    facts_ = path_->facts();
    blocks_ = path_->blocks();
    if (!facts_.force) throw input_error(fmt::format("{}: its rows have no measured force", facts_.name));
    if (facts_.longest_interval > kLongestForceGap)
      throw input_error(
          fmt::format("{}: a gap of {:.2g} s lies between two samples, and the force of the expert's device cannot be "
                      "computed across it; choose a part without a gap (--from, --to), or replay the sent force",
                      facts_.name, facts_.longest_interval));
    const double interval = facts_.rows > 1 ? facts_.duration() / static_cast<double>(facts_.rows - 1) : kCoarsestStep;
    step_ = std::clamp(interval, kFinestStep, kCoarsestStep);
    margin_ = static_cast<std::uint64_t>(std::ceil(kMargin / std::max(interval, 1e-6)));
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    first = std::min(first, facts_.rows - 1);
    count = std::clamp<std::uint64_t>(count, 1, facts_.rows - first);
    const std::uint64_t from = first - std::min(first, margin_);
    const Path wide = path_->read(from, count + (first - from) + margin_);
    const std::vector<Vec3> task = task_of(wide, handle_, step_);
    Path path = path_->read(first, count);
    const auto begin = task.begin() + static_cast<std::ptrdiff_t>(first - from);
    path.force.assign(begin, begin + static_cast<std::ptrdiff_t>(path.size()));
    return path;
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override { return path_->row_at(time); }

 private:
  std::shared_ptr<const PathSource> path_;
  HandleForce handle_;
  double step_ = kCoarsestStep;  ///< [s]
  std::uint64_t margin_ = 0;     ///< [rows]
};

/// Gathers every n-th magnitude, for percentiles.
class Magnitudes {
 public:
  explicit Magnitudes(std::uint64_t rows) : every_(rows / kMost + 1) {}
  void add(const Vec3& force) {
    if (count_++ % every_ == 0) values_.push_back(force.norm());
  }
  [[nodiscard]] double percentile99() {
    if (values_.empty()) return 0;
    const auto at = values_.begin() + static_cast<std::ptrdiff_t>(99 * (values_.size() - 1) / 100);
    std::nth_element(values_.begin(), at, values_.end());
    return *at;
  }

 private:
  static constexpr std::uint64_t kMost = 100'000;
  std::uint64_t every_, count_ = 0;
  std::vector<double> values_;
};

/// Adds up the work of the force on the hand where the device sent none, in steps long enough to hide encoder counts.
class FreeWork {
 public:
  void add(double time, const Vec3& position, const Vec3& force, bool free, ForceSurvey& survey) {
    constexpr double kStep = 0.01;  // [s]
    if (!free) {
      begun_ = false;
      return;
    }
    if (!begun_) return begin(time, position, force);
    if (time - time_ < kStep) return;
    const Vec3 moved = position - position_, mean = 0.5 * (force + force_);
    survey.path_length += moved.norm();
    survey.work += mean.dot(moved);
    survey.effort += std::abs(mean.dot(moved));
    survey.displacement = (net_ += moved).norm();
    begin(time, position, force);
  }

 private:
  void begin(double time, const Vec3& position, const Vec3& force) {
    begun_ = true;
    time_ = time;
    position_ = position;
    force_ = force;
  }

  bool begun_ = false;
  double time_ = 0;
  Vec3 position_ = Vec3::Zero(), force_ = Vec3::Zero(), net_ = Vec3::Zero();
};

/// Returns the velocity at row `i` over `window` rows on either side [m/s].
Vec3 velocity_at(const Path& rows, std::size_t i, std::size_t window) {
  const std::size_t from = i - std::min(i, window), to = std::min(i + window, rows.size() - 1);
  return to > from ? Vec3((rows.position[to] - rows.position[from]) / (rows.time[to] - rows.time[from])) : Vec3::Zero();
}

/// Returns `force` without what the dry friction can hold along axes on which the device rests: there it is not known.
Vec3 beyond_dry_friction(Vec3 force, const Vec3& velocity, const Vec3& coulomb) {
  constexpr double kResting = 5e-3;  // [m/s]
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(velocity[axis]) < kResting)
      force[axis] = std::copysign(std::max(0.0, std::abs(force[axis]) - coulomb[axis]), force[axis]);
  return force;
}

}  // namespace

std::shared_ptr<const PathSource> task_force(std::shared_ptr<const PathSource> path, const HandleForce& handle) {
  return std::make_shared<TaskForcePath>(std::move(path), handle);
}

bool ForceSurvey::drives_the_hand() const noexcept {
  constexpr double kShortest = 0.05, kBackAndForth = 3, kClearly = 0.2;  // [m]
  return path_length > std::max(kShortest, kBackAndForth * displacement) && work > kClearly * effort;
}

bool ForceSurvey::only_the_device() const noexcept {
  return task <= std::max(3 * noise, 0.25 * drag);
}

ForceSurvey survey_forces(const PathSource& sent, const std::shared_ptr<const PathSource>& measured,
                          const HandleForce& handle) {
  const double interval = measured->facts().duration() / std::max(1.0, static_cast<double>(measured->facts().rows) - 1);
  constexpr double kHalfWindow = 5e-3;  // [s]
  const auto window = static_cast<std::size_t>(std::max(1.0, std::round(kHalfWindow / std::max(interval, 1e-6))));
  const std::shared_ptr<const PathSource> task = task_force(measured, handle),
                                          passed = task_force(measured, {.negated = handle.negated});
  const PathFacts& facts = measured->facts();
  ForceSurvey survey;
  FreeWork work;
  Magnitudes drag(facts.rows), rest(facts.rows);
  double rough2 = 0;
  constexpr double kNoForce = 0.02;  // [N]
  for (std::uint64_t row = 0; row < facts.rows; row += PathBlocks::kRows) {
    const Path raw = measured->read(row, PathBlocks::kRows), smooth = passed->read(row, PathBlocks::kRows),
               of_task = task->read(row, PathBlocks::kRows), commanded = sent.read(row, PathBlocks::kRows);
    for (std::size_t i = 0; i < raw.size(); ++i) {
      rough2 += ((handle.negated ? -1 : 1) * raw.force[i] - smooth.force[i]).squaredNorm();
      const Vec3 weight = handle.plant.gravity + handle.plant.gravity_gradient * raw.position[i];
      drag.add(of_task.force[i] - smooth.force[i] + weight);
      rest.add(beyond_dry_friction(of_task.force[i], velocity_at(raw, i, window), handle.plant.coulomb));
      const bool free = commanded.force.empty() || commanded.force[i].norm() < kNoForce;
      work.add(raw.time[i], raw.position[i], smooth.force[i], free, survey);
    }
  }
  const double rows = static_cast<double>(facts.rows),
               nyquist = facts.duration() > 0 ? 0.5 * rows / facts.duration() : 0;
  // White noise: the same density below the cut-off as above.
  if (nyquist > 2 * kExpertForceCutoff)
    survey.noise = std::sqrt(rough2 / rows * kExpertForceCutoff / (nyquist - kExpertForceCutoff));
  survey.drag = drag.percentile99();
  survey.task = rest.percentile99();
  return survey;
}

}  // namespace haptrace
