#include "control/path/place_evidence.h"

#include "control/path/place_weights.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

namespace haptrace {
namespace {

// Lengths and weights are those of a path with a diagonal of kDiagonal; see PlaceWeights.
constexpr double kDiagonal = kPlaceWeights.diagonal;
constexpr double kSigma = kPlaceWeights.sigma, kLambda = kPlaceWeights.lambda;
constexpr double kWeightDistance = kPlaceWeights.distance, kWeightHeading = kPlaceWeights.heading;
constexpr double kWeightSkip = kPlaceWeights.skip, kWeightBack = kPlaceWeights.back;
constexpr auto kCap = static_cast<float>(kPlaceWeights.cap), kCapBehind = static_cast<float>(kPlaceWeights.cap_behind);
constexpr double kChord = kPlaceWeights.chord, kShortestChord = kPlaceWeights.least_chord;
constexpr double kAdvance = kPlaceWeights.advance;
constexpr double kStateSpacing = 1e-3;                   // h; 2 mm lets a hand with strong tremor run ahead [m]
constexpr double kUpdateStep = 1e-3;                     // least movement of an update [m]
constexpr double kLeastNet = 0.15;                       // least q
constexpr double kTremorCutoff = 3;                      // of the low-passed hand [Hz]
constexpr double kLeastFactor = 0.02, kMostFactor = 20;  // factor on lengths
constexpr double kCounts = 5;                            // least movement of an update [position resolutions]
constexpr double kLongestStep = 20e-3;                   // longest movement that one update counts [m]
constexpr std::size_t kAllStates = 1501;                 // longer paths have a window ...
constexpr std::size_t kWindowStates = 801;               // ... of so many states
constexpr std::size_t kWindowShift = 100;                // the window follows the best in such steps
constexpr double kLost = 7, kLostFor = 5e-3;             // a search begins when A of the best exceeds it for [m]
constexpr std::size_t kSearched = 64;                    // states searched per update
constexpr double kFound = 2;                             // the search ends at a mismatch below this
constexpr std::size_t kLocal = 6;                        // a rival is the best within so many states

/// A total cost in units of kKeyUnit, above the bits of A: keys are compared and added as whole numbers, without
/// branches that no processor could predict, and the smaller one brings its A along.
using Key = std::uint64_t;
constexpr float kKeyUnit = 1.0F / (1 << 20), kLargestInKey = 2000;

Key key_of(float total, float forgotten) noexcept {
  const auto cost = static_cast<std::int32_t>(std::min(total, kLargestInKey) / kKeyUnit);
  return Key{static_cast<std::uint32_t>(cost)} << 32U | std::bit_cast<std::uint32_t>(forgotten);
}

double diagonal_of(const ArcPath& path) {
  Vec3 least = path.position_at(0), most = least;
  for (std::size_t i = 0; i < path.knots(); ++i) {
    const Vec3 p = path.position_at(path.knot_at(i));
    least = least.cwiseMin(p);
    most = most.cwiseMax(p);
  }
  return (most - least).norm();
}

}  // namespace

PlaceEvidence::PlaceEvidence(const ArcPath& path, double resolution)
    : scale_(std::clamp(diagonal_of(path) / kDiagonal, kLeastFactor, kMostFactor)), origin_(path.position_at(0)) {
  const double length = path.length(), wanted = scale_ * kStateSpacing;
  const auto intervals = static_cast<std::size_t>(std::ceil(length / wanted));
  spacing_ = intervals > 0 ? length / static_cast<double>(intervals) : wanted;
  step_ = std::max(scale_ * kUpdateStep, kCounts * resolution);
  const std::size_t n = intervals + 1;
  for (auto* column : {&x_, &y_, &z_, &radius_, &tx_, &ty_, &tz_}) column->resize(n);
  for (std::size_t j = 0; j < n; ++j) {
    const ArcPath::Place place = path.at(s_of(j));
    const Vec3 offset = place.position - origin_;
    // The chord before the state; at the start of the path, that after it.
    const double chord = scale_ * kChord, to = std::max(s_of(j), std::min(chord, length));
    const Vec3 way = path.position_at(to) - path.position_at(std::max(to - chord, 0.0));
    const Vec3 unit = way.norm() > 0 ? Vec3(way.normalized()) : Vec3::Zero();
    x_[j] = static_cast<float>(offset.x()), y_[j] = static_cast<float>(offset.y());
    z_[j] = static_cast<float>(offset.z()), radius_[j] = static_cast<float>(place.radius);
    tx_[j] = static_cast<float>(unit.x()), ty_[j] = static_cast<float>(unit.y());
    tz_[j] = static_cast<float>(unit.z());
  }
  const std::size_t weighed = n > kAllStates ? kWindowStates : n;
  for (auto* column : {&total_, &kept_, &forgotten_}) column->resize(weighed);
  key_.resize(weighed);
  start(0, origin_);
}

std::size_t PlaceEvidence::state_at(double s) const noexcept {
  const double last = static_cast<double>(x_.size() - 1);
  return static_cast<std::size_t>(std::clamp(std::round(s / spacing_), 0.0, last));
}

void PlaceEvidence::start(double s, const Vec3& position) noexcept {
  const std::size_t at = state_at(s), half = total_.size() / 2;
  first_ = windowed() ? std::min(at - std::min(at, half), x_.size() - total_.size()) : 0;
  for (std::size_t i = 0; i < total_.size(); ++i) {
    const double ahead = s_of(first_ + i) - s_of(at);
    const double cost = (ahead > 0 ? kWeightSkip * ahead : -kWeightBack * ahead) / scale_;
    kept_[i] = static_cast<float>(std::min<double>(cost, ahead > 0 ? kCap : kCap + kCapBehind));
    forgotten_[i] = 0;
    total_[i] = kept_[i];
  }
  seen_[newest_ = 0] = {position, 0};
  seen_count_ = 1;
  slow_ = slow_before_ = position;
  lost_ = 0;
  search_ = 0;
  conclude();
}

Vec3 PlaceEvidence::chord() const noexcept {
  double travelled = 0;
  std::size_t ago = 0;
  while (ago + 1 < seen_count_ && travelled < scale_ * kChord) travelled += seen(ago++).step;
  const Vec3 way = seen(0).position - seen(ago).position;
  const double length = way.norm();
  return length >= scale_ * kShortestChord ? Vec3(way / length) : Vec3::Zero();
}

bool PlaceEvidence::update(const Vec3& position, double dt) noexcept {
  slow_ += -std::expm1(-2 * std::numbers::pi * kTremorCutoff * std::max(dt, 0.0)) * (position - slow_);
  const double moved = (position - seen(0).position).norm();
  if (!(moved >= step_)) return false;
  newest_ = (newest_ + 1) % seen_.size();
  seen_[newest_] = {position, moved};
  seen_count_ = std::min(seen_count_ + 1, seen_.size());
  const double net = std::clamp((slow_ - slow_before_).norm() / moved, kLeastNet, 1.0);
  slow_before_ = slow_;

  const double step = std::min(moved, scale_ * kLongestStep);
  advance(static_cast<std::size_t>(std::max(std::round(kAdvance * step * net / spacing_), 1.0)));
  sweep();
  observe(position, step);
  conclude();
  if (windowed()) {
    move_window();
    search(step);
  }
  return true;
}

void PlaceEvidence::advance(std::size_t reach) noexcept {
  const std::size_t n = key_.size();
  for (std::size_t j = 0; j < n; ++j) key_[j] = key_of(total_[j], forgotten_[j]);
  // The least of the states up to `reach` behind: by doubling the width of the window.
  for (std::size_t width = 0; width < std::min(reach, n - 1);) {
    const std::size_t by = std::min({width + 1, reach - width, n - 1});
    for (std::size_t j = n; j-- > by;) key_[j] = std::min(key_[j], key_[j - by]);
    width += by;
  }
}

void PlaceEvidence::sweep() noexcept {
  const std::size_t n = key_.size();
  const Key skip = key_of(static_cast<float>(kWeightSkip * spacing_ / scale_), 0);
  const Key back = key_of(static_cast<float>(kWeightBack * spacing_ / scale_), 0);
  Key least = key_[0];
  for (std::size_t j = 1; j < n; ++j) key_[j] = least = std::min(least + skip, key_[j]);
  for (std::size_t j = n - 1; j-- > 0;) key_[j] = least = std::min(least + back, key_[j]);
  for (std::size_t j = 0; j < n; ++j) {
    total_[j] = kKeyUnit * static_cast<float>(static_cast<std::int32_t>(key_[j] >> 32U));
    forgotten_[j] = std::bit_cast<float>(static_cast<std::uint32_t>(key_[j]));
  }
}

void PlaceEvidence::observe(const Vec3& position, double step) noexcept {
  const auto best = static_cast<std::size_t>(std::min_element(total_.begin(), total_.end()) - total_.begin());
  const float least = total_[best], of_least = forgotten_[best];
  const Eigen::Vector3f hand = (position - origin_).cast<float>(), heading = chord().cast<float>();
  const float px = hand.x(), py = hand.y(), pz = hand.z(), ux = heading.x(), uy = heading.y(), uz = heading.z();
  const auto decay = static_cast<float>(std::exp(-step / (scale_ * kLambda)));
  const auto of_distance = static_cast<float>(kWeightDistance * step / scale_);
  const float of_heading = heading.isZero(0) ? 0 : static_cast<float>(kWeightHeading * step / scale_);
  const auto sharpness = static_cast<float>(1 / (scale_ * kSigma * scale_ * kSigma));
  const std::size_t n = total_.size();
  const float *x = x_.data() + first_, *y = y_.data() + first_, *z = z_.data() + first_;
  const float *tx = tx_.data() + first_, *ty = ty_.data() + first_, *tz = tz_.data() + first_;
  // The columns do not overlap.
  float* __restrict total = total_.data(), * __restrict kept = kept_.data(), * __restrict forgotten = forgotten_.data();
  const auto weigh = [&](std::size_t from, std::size_t to, float restart) {
    for (std::size_t j = from; j < to; ++j) {
      const bool anew = restart < total[j];
      const float m = anew ? restart : total[j], a = anew ? of_least : forgotten[j];
      const float dx = x[j] - px, dy = y[j] - py, dz = z[j] - pz;
      const float distance2 = dx * dx + dy * dy + dz * dz;
      const float off = 1 - (ux * tx[j] + uy * ty[j] + uz * tz[j]);
      kept[j] = m - a + of_heading * off;
      forgotten[j] = a * decay + of_distance * (std::sqrt(1 + sharpness * distance2) - 1);
      total[j] = kept[j] + forgotten[j];
    }
  };
  weigh(0, best, least + kCap + kCapBehind);
  weigh(best, n, least + kCap);
}

void PlaceEvidence::conclude() noexcept {
  best_ = static_cast<std::size_t>(std::min_element(total_.begin(), total_.end()) - total_.begin());
  const float least = total_[best_];
  for (float& cost : kept_) cost -= least;
  for (float& cost : total_) cost -= least;
  stretch_count_ = 0;
  for (std::size_t i = 0; i < total_.size(); ++i) {
    if (!(total_[i] < static_cast<float>(kPlausible))) continue;
    const std::size_t begin = i;
    while (i + 1 < total_.size() && total_[i + 1] < static_cast<float>(kPlausible)) ++i;
    if (stretch_count_ < kMostStretches)
      stretches_[stretch_count_++] = {s_of(first_ + begin), s_of(first_ + i)};
    else
      stretches_[kMostStretches - 1].to = s_of(first_ + i);
  }
}

PlaceEvidence::Candidate PlaceEvidence::best_within(double s, double range) const noexcept {
  const std::size_t last = first_ + total_.size() - 1;
  const std::size_t from = std::clamp(state_at(s - range), first_, last),
                    to = std::clamp(state_at(s + range), from, last);
  std::size_t best = from;
  for (std::size_t j = from; j <= to; ++j)
    if (total_[j - first_] < total_[best - first_]) best = j;
  return {s_of(best), total_[best - first_]};
}

PlaceEvidence::Candidate PlaceEvidence::next_rival(double from, double s, double range, double most) const noexcept {
  const std::size_t n = total_.size();
  const auto begin_state = static_cast<std::size_t>(std::max(std::round(from / spacing_), 0.0));
  for (std::size_t i = std::max(begin_state, first_) - first_; i < n; ++i) {
    const float cost = total_[i];
    if (!(cost < most) || std::abs(s_of(first_ + i) - s) <= range) continue;
    const auto begin = total_.begin() + static_cast<std::ptrdiff_t>(i - std::min(i, kLocal));
    const auto end = total_.begin() + static_cast<std::ptrdiff_t>(std::min(i + kLocal + 1, n));
    if (std::none_of(begin, end, [cost](float other) { return other < cost; })) return {s_of(first_ + i), cost};
  }
  return {s, std::numeric_limits<double>::infinity()};
}

PlaceEvidence::Nearest PlaceEvidence::nearest_in(const Stretch& stretch, const Vec3& position) const noexcept {
  const Eigen::Vector3f hand = (position - origin_).cast<float>();
  const std::size_t from = state_at(stretch.from), to = state_at(stretch.to);
  std::size_t nearest = from;
  float depth = std::numeric_limits<float>::infinity();
  for (std::size_t j = from; j <= to; ++j) {
    const float dx = x_[j] - hand.x(), dy = y_[j] - hand.y(), dz = z_[j] - hand.z();
    const float here = std::sqrt(dx * dx + dy * dy + dz * dz) - radius_[j];
    if (here < depth) {
      depth = here;
      nearest = j;
    }
  }
  return {s_of(nearest), depth};
}

void PlaceEvidence::move_window() noexcept {
  const std::size_t n = total_.size(), half = n / 2, left_out = x_.size() - n;
  const bool ahead = best_ > half + kWindowShift, behind = best_ + kWindowShift < half;
  if (!(ahead && first_ < left_out) && !(behind && first_ > 0)) return;
  const std::size_t by = std::min(kWindowShift, ahead ? left_out - first_ : first_);
  const auto shift = static_cast<std::ptrdiff_t>(by);
  // A state that enters the window may only be reached by a restart.
  for (auto [column, entering] : {std::pair(&total_, kCap), std::pair(&kept_, kCap), std::pair(&forgotten_, 0.0F)}) {
    if (ahead) {
      std::copy(column->begin() + shift, column->end(), column->begin());
      std::fill(column->end() - shift, column->end(), entering);
    } else {
      std::copy_backward(column->begin(), column->end() - shift, column->end());
      std::fill(column->begin(), column->begin() + shift, entering);
    }
  }
  first_ = ahead ? first_ + by : first_ - by;
  best_ = ahead ? best_ - by : best_ + by;
}

double PlaceEvidence::mismatch(std::size_t state) const noexcept {
  // The cost A of a hand that has walked along the path to this state.
  double cost = 0, ago_length = 0;
  for (std::size_t ago = 0; ago < seen_count_ && ago_length < scale_ * kLambda; ++ago) {
    const std::size_t back = static_cast<std::size_t>(ago_length / spacing_);
    const std::size_t j = state - std::min(state, back);
    const Vec3 point = origin_ + Vec3(x_[j], y_[j], z_[j]);
    const double distance = (seen(ago).position - point).norm() / (scale_ * kSigma), step = seen(ago).step;
    cost +=
        kWeightDistance * step / scale_ * (std::hypot(1, distance) - 1) * std::exp(-ago_length / (scale_ * kLambda));
    ago_length += step;
  }
  return cost;
}

void PlaceEvidence::search(double step) noexcept {
  lost_ = forgotten_[best_] > kLost ? lost_ + step : 0;
  if (lost_ < scale_ * kLostFor) return;
  for (std::size_t i = 0; i < kSearched; ++i) {
    search_ = search_ + 1 < x_.size() ? search_ + 1 : 0;
    if (search_ >= first_ && search_ < first_ + total_.size()) continue;
    // Most states are far from the hand, which costs little to see.
    const Vec3 point = origin_ + Vec3(x_[search_], y_[search_], z_[search_]);
    if ((seen(0).position - point).norm() > 3 * scale_ * kSigma || mismatch(search_) > kFound) continue;
    jump_to(search_);
    return;
  }
}

void PlaceEvidence::jump_to(std::size_t state) noexcept {
  const std::size_t half = total_.size() / 2;
  first_ = std::min(state - std::min(state, half), x_.size() - total_.size());
  std::fill(forgotten_.begin(), forgotten_.end(), 0.0F);
  std::fill(kept_.begin(), kept_.end(), kCap);
  constexpr std::size_t kNear = 32;  // the states whose match is computed
  for (std::size_t j = state - std::min(state - first_, kNear);
       j <= std::min(state + kNear, first_ + total_.size() - 1); ++j) {
    forgotten_[j - first_] = static_cast<float>(mismatch(j));
    kept_[j - first_] = 0;
  }
  for (std::size_t i = 0; i < total_.size(); ++i) total_[i] = kept_[i] + forgotten_[i];
  lost_ = 0;
  conclude();
}

}  // namespace haptrace
