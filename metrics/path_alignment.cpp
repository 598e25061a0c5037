#include "metrics/path_alignment.h"

#include "control/path/path.h"
#include "control/path/place_weights.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace haptrace {
namespace {

// Lengths are in the unit of the curve, which is 1 mm for a curve with a diagonal of 110 mm.
constexpr double kUsualDiagonal = kPlaceWeights.diagonal, kMillimetre = 1e-3, kLeastUnit = 1e-4;  // [m]
constexpr double kMostStates = 2000, kMostUpdates = 3000;

/// Returns a length of kPlaceWeights in that unit, or a weight per length.
constexpr float length_of(double metres) {
  return static_cast<float>(metres / kMillimetre);
}
constexpr float weight_of(double per_metre) {
  return static_cast<float>(per_metre * kMillimetre);
}

constexpr float kSkip = weight_of(kPlaceWeights.skip), kBack = weight_of(kPlaceWeights.back);
constexpr float kDistance = weight_of(kPlaceWeights.distance), kHeading = weight_of(kPlaceWeights.heading);
constexpr float kSigma = length_of(kPlaceWeights.sigma), kForget = length_of(kPlaceWeights.lambda);
constexpr auto kCap = static_cast<float>(kPlaceWeights.cap), kBehind = static_cast<float>(kPlaceWeights.cap_behind);
constexpr auto kCapKept = static_cast<float>(kPlaceWeights.cap_kept);
constexpr float kFarthest = 1e8F;  // bounds a squared distance, so that sums of costs stay finite
constexpr double kChord = length_of(kPlaceWeights.chord), kLeastChord = length_of(kPlaceWeights.least_chord);
constexpr double kFollow = kPlaceWeights.advance, kWindow = 12;

double unit_of(const Polyline& curve) {
  Box box;
  constexpr std::size_t kPoints = 256;
  for (std::size_t i = 0; i <= kPoints; ++i) box.include(curve.at(curve.length() * static_cast<double>(i) / kPoints));
  return std::max(kLeastUnit, kMillimetre * box.size().norm() / kUsualDiagonal);
}

/// A position of the hand at which the states are updated.
struct Update {
  Vec3 position;
  std::size_t row = 0;  ///< the row that reached it
};

/// Returns the hand's positions `spacing` apart in space. Rest and tremor within the spacing leave none, and a gap is
/// crossed on a straight line.
std::vector<Update> updates_of(std::span<const Vec3> position, double spacing) {
  std::vector<Update> updates;
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (!is_finite(position[i])) continue;
    if (updates.empty()) updates.push_back({position[i], i});
    constexpr double kLongestGap = 50;  // spacings; a hand that was lost for longer counts as one update
    if ((position[i] - updates.back().position).norm() > kLongestGap * spacing) updates.push_back({position[i], i});
    for (double left = (position[i] - updates.back().position).norm(); left >= spacing;) {
      const Vec3 towards = position[i] - updates.back().position;
      updates.push_back({updates.back().position + towards * (spacing / left), i});
      left = (position[i] - updates.back().position).norm();
    }
  }
  return updates;
}

/// Returns the unit vector of the chord from a to b; nothing if it is shorter than `least`.
std::optional<Vec3> direction(const Vec3& a, const Vec3& b, double least) {
  const Vec3 chord = b - a;
  const double length = chord.norm();
  return length >= least && std::isfinite(length) ? std::optional(Vec3(chord / length)) : std::nullopt;
}

/// The states along the curve, and the best predecessor of each at every update.
class States {
 public:
  States(const Polyline& curve, double unit) : unit_(unit), spacing_(spacing_of(curve, unit)) {
    const std::vector<Vec3> points = curve.resampled(spacing_);
    spacing_ = curve.length() / static_cast<double>(points.size() - 1);
    const auto reach = static_cast<std::size_t>(std::max(1.0, std::round(kChord / 2 * unit_ / spacing_)));
    for (std::size_t j = 0; j < points.size(); ++j) {
      const Vec3 &before = points[j >= reach ? j - reach : 0], &after = points[std::min(j + reach, points.size() - 1)];
      const Vec3 tangent = direction(before, after, 0.1 * spacing_).value_or(Vec3::Zero());
      for (std::size_t axis = 0; axis < 3; ++axis) {
        point_[axis].push_back(static_cast<float>(points[j][static_cast<Eigen::Index>(axis)] / unit_));
        tangent_[axis].push_back(static_cast<float>(tangent[static_cast<Eigen::Index>(axis)]));
      }
      kept_.push_back(std::min(kCap, kSkip * step() * static_cast<float>(j)));
    }
    forgotten_.assign(points.size(), 0);
    total_.resize(points.size());
    from_.resize(points.size());
  }

  [[nodiscard]] std::size_t size() const { return kept_.size(); }
  [[nodiscard]] double spacing() const { return spacing_; }  ///< [m]

  /// Observes the hand after a movement of `moved` [m] with the chord `heading`.
  void update(const Vec3& position, double moved, const std::optional<Vec3>& heading) {
    const auto dl = static_cast<float>(moved / unit_);
    if (updates_++ > 0) transition(follow(moved));
    observe(position / unit_, dl, heading);
    if (updates_ > 1) origins_.insert(origins_.end(), from_.begin(), from_.end());
  }

  /// Returns how many states a hand can follow while it moves this far [m].
  [[nodiscard]] std::size_t follow(double moved) const {
    return static_cast<std::size_t>(std::max(1.0, std::round(kFollow * moved / spacing_)));
  }

  /// Returns the best state at every update, read back from the last one.
  [[nodiscard]] std::vector<std::size_t> best() const {
    std::vector<std::size_t> states(updates_);
    std::size_t last = 0;
    for (std::size_t j = 1; j < size(); ++j)
      if (kept_[j] + forgotten_[j] < kept_[last] + forgotten_[last]) last = j;
    for (std::size_t k = updates_; k-- > 0;) {
      states[k] = last;
      if (k > 0) last = origins_[(k - 1) * size() + last];
    }
    return states;
  }

 private:
  static double spacing_of(const Polyline& curve, double unit) {
    return std::max(unit, curve.length() / (kMostStates - 1));
  }
  [[nodiscard]] float step() const { return static_cast<float>(spacing_ / unit_); }

  /// Lets a state come from another if that is cheaper.
  void offer(std::size_t to, std::size_t from, float cost) {
    if (!(cost < total_[to])) return;
    total_[to] = cost;
    next_forgotten_[to] = next_forgotten_[from];
    from_[to] = from_[from];
  }

  void transition(std::size_t follow) {
    const std::size_t n = size();
    next_forgotten_ = forgotten_;
    for (std::size_t j = 0; j < n; ++j) {
      std::size_t best = j;
      float least = kept_[j] + forgotten_[j];
      for (std::size_t back = 1; back <= std::min(follow, j); ++back)
        if (const float cost = kept_[j - back] + forgotten_[j - back]; cost < least) {
          least = cost;
          best = j - back;
        }
      total_[j] = least;
      next_forgotten_[j] = forgotten_[best];
      from_[j] = static_cast<std::uint16_t>(best);
    }
    for (std::size_t j = 1; j < n; ++j) offer(j, j - 1, total_[j - 1] + kSkip * step());
    for (std::size_t j = n - 1; j-- > 0;) offer(j, j + 1, total_[j + 1] + kBack * step());
    const auto best = static_cast<std::size_t>(std::min_element(total_.begin(), total_.end()) - total_.begin());
    const float least = total_[best];
    for (std::size_t j = 0; j < n; ++j) {
      offer(j, best, least + kCap + (j < best ? kBehind : 0));
      kept_[j] = total_[j] - next_forgotten_[j];
    }
    const float most_kept = *std::min_element(kept_.begin(), kept_.end()) + kCapKept;
    for (float& kept : kept_) kept = std::min(kept, most_kept);
    forgotten_ = next_forgotten_;
  }

  void observe(const Vec3& position, float dl, const std::optional<Vec3>& heading) {
    const Eigen::Vector3f p = position.cast<float>(), u = heading.value_or(Vec3::Zero()).cast<float>();
    const float fade = std::exp(-dl / kForget), weight = heading ? kHeading * dl : 0;
    float least = std::numeric_limits<float>::infinity();
    for (std::size_t j = 0; j < size(); ++j) {
      const float x = p.x() - point_[0][j], y = p.y() - point_[1][j], z = p.z() - point_[2][j];
      const float along = u.x() * tangent_[0][j] + u.y() * tangent_[1][j] + u.z() * tangent_[2][j];
      kept_[j] += weight * heading_deviation(along);
      const float away = std::min((x * x + y * y + z * z) / (kSigma * kSigma), kFarthest);
      forgotten_[j] = forgotten_[j] * fade + kDistance * dl * (std::sqrt(1 + away) - 1);
      least = std::min(least, kept_[j] + forgotten_[j]);
    }
    for (float& cost : kept_) cost -= least;
  }

  double unit_, spacing_;  ///< [m]
  std::size_t updates_ = 0;
  std::array<std::vector<float>, 3> point_, tangent_;
  std::vector<float> kept_, forgotten_, total_, next_forgotten_;
  std::vector<std::uint16_t> from_, origins_;
};

/// Finds the foot points of the rows near a sequence of states.
class Feet {
 public:
  Feet(const Polyline& curve, std::span<const Vec3> position, double window)
      : curve_(curve), position_(position), window_(window) {
    result_.arc.assign(position.size(), kNaN);
  }

  /// Sets the rows up to `end` between the places `from` and `to`; with `jumps`, each is near the one or the other.
  void until(std::size_t end, double from, double to, bool jumps) {
    bool left = false;
    for (; row_ < end; ++row_) {
      const Vec3& p = position_[row_];
      if (!is_finite(p)) continue;
      double foot = jumps ? near(p, from, from) : near(p, std::min(from, to), std::max(from, to));
      if (jumps) {
        const double other = near(p, to, to);
        const bool there = left || distance(p, other) < distance(p, foot);
        if (there) foot = other;
        if (there && !left) jump();
        left = left || there;
      }
      set(foot);
    }
    if (jumps && !left) jump();
  }

  PathAlignment finish() {
    jump_without_mark();
    std::sort(passed_.begin(), passed_.end());
    double end = 0;
    for (const auto& [low, high] : passed_) {
      result_.covered += std::max(0.0, high - std::max(low, end));
      end = std::max(end, high);
    }
    return std::move(result_);
  }

 private:
  [[nodiscard]] double near(const Vec3& p, double low, double high) const {
    return curve_.nearest(p, low - window_, high + window_);
  }
  [[nodiscard]] double distance(const Vec3& p, double arc) const { return (p - curve_.at(arc)).squaredNorm(); }

  void set(double foot) {
    result_.arc[row_] = foot;
    result_.farthest = std::max(result_.farthest, foot);
    low_ = std::min(low_, foot);
    high_ = std::max(high_, foot);
  }

  void jump() {
    result_.jumps.push_back(row_);
    jump_without_mark();
  }
  void jump_without_mark() {
    if (low_ <= high_) passed_.emplace_back(low_, high_);
    low_ = std::numeric_limits<double>::infinity();
    high_ = -low_;
  }

  const Polyline& curve_;
  std::span<const Vec3> position_;
  double window_;  ///< [m]
  std::size_t row_ = 0;
  PathAlignment result_;
  std::vector<std::pair<double, double>> passed_;  ///< stretches of arc length without jumps [m]
  double low_ = std::numeric_limits<double>::infinity(), high_ = -std::numeric_limits<double>::infinity();
};

}  // namespace

PathAlignment align_with_path(const Polyline& curve, std::span<const Vec3> position) {
  const double unit = unit_of(curve);
  if (!(curve.length() > 0)) {
    Feet feet(curve, position, 0);
    feet.until(position.size(), 0, 0, false);
    return feet.finish();
  }
  States states(curve, unit);
  double spacing = std::max(unit, states.spacing());
  std::vector<Update> updates = updates_of(position, spacing);
  if (static_cast<double>(updates.size()) > kMostUpdates) {
    spacing *= static_cast<double>(updates.size()) / kMostUpdates;
    updates = updates_of(position, spacing);
  }
  const auto chord = static_cast<std::size_t>(std::max(1.0, std::round(kChord * unit / spacing)));
  for (std::size_t k = 0; k < updates.size(); ++k)
    states.update(updates[k].position, spacing,
                  direction(updates[k >= chord ? k - chord : 0].position, updates[k].position, kLeastChord * unit));

  Feet feet(curve, position, kWindow * unit);
  const std::vector<std::size_t> best = states.best();
  const auto follow = static_cast<std::ptrdiff_t>(states.follow(spacing));
  for (std::size_t k = 0; k < best.size(); ++k) {
    const std::size_t next = std::min(k + 1, best.size() - 1);
    const auto advance = static_cast<std::ptrdiff_t>(best[next]) - static_cast<std::ptrdiff_t>(best[k]);
    feet.until(next > k ? updates[next].row : position.size(), states.spacing() * static_cast<double>(best[k]),
               states.spacing() * static_cast<double>(best[next]), std::abs(advance) > follow);
  }
  return feet.finish();
}

}  // namespace haptrace
