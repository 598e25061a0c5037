#include "control/path/place_evidence.h"

#include "control/filters.h"
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
constexpr auto kCapKept = static_cast<float>(kPlaceWeights.cap_kept);
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

// A hand shakes if its low pass stays as near to a spot as kSpot for so long, and it moves so far there [m, s, m].
constexpr double kSpot = 6e-3, kShakesLong = 1, kShakesFor = 40e-3;

/// A total cost in whole units above the bits of A. Both are compared and added at once, as a whole number, without a
/// branch that no processor could predict: the smaller cost brings its A along.
using Key = std::uint64_t;
constexpr float kCostUnit = 1.0F / (1 << 20), kMostCost = 2000;

std::int32_t units_of(float cost) noexcept {
  return static_cast<std::int32_t>((cost < kMostCost ? cost : kMostCost) * (1 / kCostUnit));
}
constexpr Key key_of(std::int32_t units, std::uint32_t bits) noexcept {
  return Key{static_cast<std::uint32_t>(units)} << 32U | bits;
}

// The loops over all states stand by themselves, with columns that do not overlap: the compiler makes vector
// instructions of them.

/// Sets every state to the cheaper of itself and the state `by` before it.
void take_from_behind(const std::int32_t* __restrict cost, const float* __restrict a, std::size_t n, std::size_t by,
                      std::int32_t* __restrict least_cost, float* __restrict of_least) noexcept {
  std::copy_n(cost, by, least_cost);
  std::copy_n(a, by, of_least);
  for (std::size_t j = by; j < n; ++j) {
    // All are read, whichever is taken: a read that depends on a comparison would be a branch.
    const std::int32_t behind = cost[j - by], here = cost[j];
    const float a_behind = a[j - by], a_here = a[j];
    least_cost[j] = behind < here ? behind : here;
    of_least[j] = behind < here ? a_behind : a_here;
  }
}

void to_units(const float* __restrict total, std::size_t n, std::int32_t* __restrict cost) noexcept {
  for (std::size_t j = 0; j < n; ++j) cost[j] = units_of(total[j]);
}

void to_keys(const std::int32_t* __restrict cost, const float* __restrict a, std::size_t n,
             Key* __restrict key) noexcept {
  for (std::size_t j = 0; j < n; ++j) key[j] = key_of(cost[j], std::bit_cast<std::uint32_t>(a[j]));
}

void from_keys(const Key* __restrict key, std::size_t n, float* __restrict total, float* __restrict a) noexcept {
  for (std::size_t j = 0; j < n; ++j) {
    total[j] = kCostUnit * static_cast<float>(static_cast<std::int32_t>(key[j] >> 32U));
    a[j] = std::bit_cast<float>(static_cast<std::uint32_t>(key[j]));
  }
}

/// Returns the index of the first of the least.
std::size_t least_of(const std::vector<float>& values) noexcept {
  constexpr std::size_t kLanes = 8;
  std::array<float, kLanes> least{};
  least.fill(values[0]);
  std::size_t j = 0;
  for (; j + kLanes <= values.size(); j += kLanes)
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      least[lane] = values[j + lane] < least[lane] ? values[j + lane] : least[lane];
  float all = *std::min_element(least.begin(), least.end());
  for (; j < values.size(); ++j) all = std::min(all, values[j]);
  return static_cast<std::size_t>(std::find(values.begin(), values.end(), all) - values.begin());
}

/// A movement of the hand, with which all states are compared.
struct Evidence {
  float px, py, pz, ux, uy, uz;                     ///< position and heading of the hand
  float decay, of_distance, of_heading, sharpness;  ///< weights
};

/// Restarts a state that costs more than `restart`, or whose B is more than `most_kept`, and adds the evidence of a
/// movement.
void weigh(const Evidence evidence, float most_kept, float restart, float of_restart, std::size_t n,
           const float* __restrict x, const float* __restrict y, const float* __restrict z, const float* __restrict tx,
           const float* __restrict ty, const float* __restrict tz, float* __restrict total, float* __restrict kept,
           float* __restrict forgotten) noexcept {
  const auto [px, py, pz, ux, uy, uz, decay, of_distance, of_heading, sharpness] = evidence;
  for (std::size_t j = 0; j < n; ++j) {
    const bool anew = restart < total[j];
    const float a = anew ? of_restart : forgotten[j], kept_so_far = (anew ? restart : total[j]) - a;
    const float dx = x[j] - px, dy = y[j] - py, dz = z[j] - pz;
    const float off = heading_deviation(ux * tx[j] + uy * ty[j] + uz * tz[j]);
    const float b = (kept_so_far < most_kept ? kept_so_far : most_kept) + of_heading * off;
    const float next = a * decay + of_distance * (std::sqrt(1 + sharpness * (dx * dx + dy * dy + dz * dz)) - 1);
    kept[j] = b;
    forgotten[j] = next;
    total[j] = b + next;
  }
}

}  // namespace

PlaceEvidence::PlaceEvidence(const ArcPath& path, double resolution)
    : scale_(std::clamp(path.diagonal() / kDiagonal, kLeastFactor, kMostFactor)), origin_(path.position_at(0)) {
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
  winds_.resize(n);
  const auto near = static_cast<std::size_t>(0.5 * scale_ * kShakesFor / spacing_);
  for (std::size_t j = 0; j < n; ++j) {
    const Vec3 here = path.position_at(s_of(j));
    winds_[j] = 1;
    for (std::size_t i = j - std::min(j, near); i <= std::min(j + near, n - 1); ++i)
      if ((path.position_at(s_of(i)) - here).norm() > scale_ * kSpot) winds_[j] = 0;
  }
  const std::size_t weighed = n > kAllStates ? kWindowStates : n;
  for (auto* column : {&total_, &kept_, &forgotten_}) column->resize(weighed);
  for (auto& column : units_) column.resize(weighed);
  for (auto& column : carried_) column.resize(weighed);
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
  spot_ = position;
  at_spot_ = time_at_spot_ = 0;
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

bool PlaceEvidence::shakes() const noexcept {
  return time_at_spot_ >= kShakesLong && at_spot_ >= scale_ * kShakesFor && winds_[first_ + best_] == 0;
}

bool PlaceEvidence::update(const Vec3& position, double dt) noexcept {
  slow_ += low_pass_share_at(kTremorCutoff, std::max(dt, 0.0)) * (position - slow_);
  time_at_spot_ += std::max(dt, 0.0);
  if ((slow_ - spot_).squaredNorm() > scale_ * kSpot * scale_ * kSpot) {
    spot_ = slow_;
    at_spot_ = time_at_spot_ = 0;
  }
  const double moved = (position - seen(0).position).norm();
  if (!(moved >= step_)) return false;
  newest_ = (newest_ + 1) % seen_.size();
  seen_[newest_] = {position, moved};
  seen_count_ = std::min(seen_count_ + 1, seen_.size());
  const double net = std::clamp((slow_ - slow_before_).norm() / moved, kLeastNet, 1.0);
  slow_before_ = slow_;
  at_spot_ += moved;
  if (shakes()) return false;

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
  const std::size_t n = total_.size();
  to_units(total_.data(), n, units_[0].data());
  const float* a = forgotten_.data();
  // The least of the states up to `reach` behind: by doubling the width of the window.
  for (std::size_t width = 0; width < std::min(reach, n - 1);) {
    const std::size_t by = std::min({width + 1, reach - width, n - 1});
    float* next = a == carried_[0].data() ? carried_[1].data() : carried_[0].data();
    take_from_behind(units_[0].data(), a, n, by, units_[1].data(), next);
    units_[0].swap(units_[1]);
    a = next;
    width += by;
  }
  to_keys(units_[0].data(), a, n, key_.data());
}

void PlaceEvidence::sweep() noexcept {
  const std::size_t n = key_.size();
  const Key skip = key_of(units_of(static_cast<float>(kWeightSkip * spacing_ / scale_)), 0);
  const Key back = key_of(units_of(static_cast<float>(kWeightBack * spacing_ / scale_)), 0);
  // Both sweeps at once, since each waits for its own last sum. They may meet: who skips and then goes back pays more.
  Key from_behind = key_[0], from_ahead = key_[n - 1];
  for (std::size_t j = 1; j < n; ++j) {
    key_[j] = from_behind = std::min(from_behind + skip, key_[j]);
    key_[n - 1 - j] = from_ahead = std::min(from_ahead + back, key_[n - 1 - j]);
  }
  from_keys(key_.data(), n, total_.data(), forgotten_.data());
}

void PlaceEvidence::observe(const Vec3& position, double step) noexcept {
  // Advancing and sweeping make no state cheaper than the best was, and that costs as much as before.
  const std::size_t n = total_.size();
  const float least = total_[best_], of_least = forgotten_[best_];
  const Eigen::Vector3f hand = (position - origin_).cast<float>(), heading = chord().cast<float>();
  Evidence evidence{};
  evidence.px = hand.x(), evidence.py = hand.y(), evidence.pz = hand.z();
  evidence.ux = heading.x(), evidence.uy = heading.y(), evidence.uz = heading.z();
  evidence.decay = static_cast<float>(std::exp(-step / (scale_ * kLambda)));
  evidence.of_distance = static_cast<float>(kWeightDistance * step / scale_);
  evidence.of_heading = heading.isZero(0) ? 0 : static_cast<float>(kWeightHeading * step / scale_);
  evidence.sharpness = static_cast<float>(1 / (scale_ * kSigma * scale_ * kSigma));
  float most_kept = std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < n; ++i) most_kept = std::min(most_kept, total_[i] - forgotten_[i] + kCapKept);
  const auto weigh_from = [&](std::size_t i, std::size_t count, float restart) {
    const std::size_t j = first_ + i;
    weigh(evidence, most_kept, restart, of_least, count, &x_[j], &y_[j], &z_[j], &tx_[j], &ty_[j], &tz_[j], &total_[i],
          &kept_[i], &forgotten_[i]);
  };
  weigh_from(0, best_, least + kCap + kCapBehind);
  weigh_from(best_, n - best_, least + kCap);
}

void PlaceEvidence::conclude() noexcept {
  best_ = least_of(total_);
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

double PlaceEvidence::recent(double s) const noexcept {
  return forgotten_[std::clamp(state_at(s), first_, first_ + total_.size() - 1) - first_];
}

PlaceEvidence::Candidate PlaceEvidence::nearest_lately(double s, double range, double same_way) const noexcept {
  const std::size_t here = state_at(s);
  const auto least_way = static_cast<float>(same_way);
  Candidate nearest{s, std::numeric_limits<double>::infinity()};
  for (std::size_t i = 0; i < forgotten_.size(); ++i) {
    if (!(forgotten_[i] < nearest.cost)) continue;
    const std::size_t j = first_ + i;
    if (std::abs(s_of(j) - s) <= range) continue;
    if (!(tx_[j] * tx_[here] + ty_[j] * ty_[here] + tz_[j] * tz_[here] > least_way)) continue;
    nearest = {s_of(j), forgotten_[i]};
  }
  return nearest;
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
