#include "formats/path/path_stretching.h"

#include "formats/path/path_blocks.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

class StretchedPath final : public PathSource {
 public:
  StretchedPath(std::shared_ptr<const PathSource> path, TimeStretch stretch)
      : path_(std::move(path)), stretch_(std::move(stretch)) {
    const PathFacts& facts = path_->facts();
    begin_ = facts.begin;
    facts_ = {.name = facts.name,
              .velocity = facts.velocity,
              .force = facts.force,
              .orientation = facts.orientation,
              .notes = facts.notes};
    PathBlocks blocks;
    for (std::uint64_t row = 0; row < facts.rows; row += PathBlocks::kRows) {
      const Path part = read(row, std::min(PathBlocks::kRows, facts.rows - row));
      for (std::size_t i = 0; i < part.size(); ++i) blocks.add(part.time[i], part.position[i]);
    }
    blocks_ = blocks.blocks();
    for (const PathBlock& block : blocks_) join_block(facts_, block);
    facts_.begin = new_stamp(facts.begin);
    facts_.end = new_stamp(facts.end);
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    Path path = path_->read(first, count);
    for (std::size_t i = 0; i < path.velocity.size(); ++i) path.velocity[i] /= stretch_.factor(path.time[i] - begin_);
    for (double& time : path.time) time = new_stamp(time);
    return path;
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override {
    std::uint64_t row = path_->row_at(begin_ + stretch_.before(time - begin_));
    // The old time is rounded, and may be that of a row beside the right one.
    const auto stamp = [&](std::uint64_t of) { return read(of, 1).time.front(); };
    if (row + 1 < facts_.rows && stamp(row + 1) <= time) return row + 1;
    if (row > 0 && stamp(row) > time) return row - 1;
    return row;
  }

 private:
  [[nodiscard]] double new_stamp(double stamp) const { return begin_ + stretch_.later(stamp - begin_); }

  std::shared_ptr<const PathSource> path_;
  TimeStretch stretch_;
  double begin_ = 0;
};

}  // namespace

TimeStretch::TimeStretch(double step, std::vector<double> factors) : step_(step), factors_(std::move(factors)) {
  times_.resize(factors_.size());
  for (std::size_t i = 1; i < factors_.size(); ++i)
    times_[i] = times_[i - 1] + 0.5 * step_ * (factors_[i - 1] + factors_[i]);
}

bool TimeStretch::is_identity() const noexcept {
  return std::all_of(factors_.begin(), factors_.end(), [](double factor) { return factor == 1; });
}

double TimeStretch::factor(double t) const noexcept {
  const double place = std::clamp(t / step_, 0.0, static_cast<double>(factors_.size() - 1));
  const auto i = static_cast<std::size_t>(place);
  return i + 1 < factors_.size() ? std::lerp(factors_[i], factors_[i + 1], place - static_cast<double>(i))
                                 : factors_.back();
}

double TimeStretch::later(double t) const noexcept {
  const double end = step_ * static_cast<double>(factors_.size() - 1);
  if (t <= 0) return t * factors_.front();
  if (t >= end) return times_.back() + (t - end) * factors_.back();
  const auto i = std::min(static_cast<std::size_t>(t / step_), factors_.size() - 2);
  const double u = t - step_ * static_cast<double>(i), slope = (factors_[i + 1] - factors_[i]) / step_;
  return times_[i] + u * (factors_[i] + 0.5 * slope * u);
}

double TimeStretch::before(double t) const noexcept {
  if (t <= 0) return t / factors_.front();
  if (t >= times_.back())
    return step_ * static_cast<double>(factors_.size() - 1) + (t - times_.back()) / factors_.back();
  const auto node = std::upper_bound(times_.begin(), times_.end(), t) - times_.begin() - 1;
  const auto i = static_cast<std::size_t>(node);
  // u (f + slope u / 2) = rest, in the form that stays exact as the slope vanishes.
  const double rest = t - times_[i], f = factors_[i], slope = (factors_[i + 1] - f) / step_;
  const double u = 2 * rest / (f + std::sqrt(std::max(0.0, f * f + 2 * slope * rest)));
  return step_ * static_cast<double>(i) + u;
}

std::vector<TimeStretch::Place> TimeStretch::places() const {
  std::vector<Place> places;
  bool inside = false;
  for (std::size_t i = 0; i < factors_.size(); ++i) {
    const bool stretched = factors_[i] > 1;
    const double t = step_ * static_cast<double>(i);
    if (stretched && !inside) places.push_back({.begin = i > 0 ? t - step_ : t, .end = t});
    if (stretched) places.back().factor = std::max(places.back().factor, factors_[i]);
    if (stretched || inside) places.back().end = t;
    inside = stretched;
  }
  return places;
}

std::shared_ptr<const PathSource> stretched(std::shared_ptr<const PathSource> path, TimeStretch stretch) {
  if (stretch.is_identity()) return path;
  return std::make_shared<StretchedPath>(std::move(path), std::move(stretch));
}

}  // namespace haptrace
