#include "formats/recording/sampling.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::int64_t kBin = 5000;          // [ns]
constexpr std::size_t kMostBins = 20'000;    // beyond this number of different steps, no single one matters
constexpr double kSame = 0.03, kLike = 0.1;  // relative difference of steps: equal up to noise; of the same kind
constexpr std::size_t kUnevenWindow = 16;    // steps
constexpr std::uint64_t kFew = 20;           // steps, too few for a conclusion
constexpr double kDisagrees = 0.1;           // of motion_ratio and 1, from which time stamps are doubted
constexpr double kJump = 5;                  // times the rms change, which no movement makes from row to row

constexpr std::array<Vec3 Sample::*, 3> kVectors{&Sample::velocity, &Sample::force, &Sample::force_measured};
constexpr std::array kVectorNames{"velocity", "force", "measured force"};
constexpr std::array kChannelNames{"x", "y", "z", "vx", "vy", "vz", "fx", "fy", "fz", "mx", "my", "mz"};

double component(const Sample& sample, std::size_t channel) {
  const auto axis = static_cast<Eigen::Index>(channel % 3);
  return channel < 3 ? sample.position[axis] : (sample.*kVectors.at(channel / 3 - 1))[axis];
}

bool like(std::int64_t a, std::int64_t b) {
  return static_cast<double>(std::abs(a - b)) <= kLike * static_cast<double>(std::min(a, b));
}

/// Returns true if `step` is `multiple` times `base`, and sets `multiple`.
bool is_multiple(double step, double base, double& multiple) {
  multiple = std::round(step / base);
  return multiple >= 1 && std::abs(step - multiple * base) <= kLike * base;
}

std::string milliseconds(double seconds) {
  return fmt::format("{:.3g}", 1e3 * seconds);
}

}  // namespace

void SamplingReport::add(const Sample& sample) {
  if (rows_++ == 0) {
    first_ns_ = last_ns_ = sample.time_ns;
  } else {
    const std::int64_t step = sample.time_ns - before_.time_ns;
    if (step > 0)
      add_step(step);
    else
      ++(step == 0 ? duplicates_ : backward_);
    add_values(sample, 1e-9 * static_cast<double>(step));
    last_ns_ = std::max(last_ns_, sample.time_ns);
  }
  before_ = sample;
}

void SamplingReport::add_step(std::int64_t step_ns) {
  if (step_count_ == 0 || step_ns < shortest_ns_) shortest_ns_ = step_ns;
  if (step_ns > longest_ns_) {
    longest_ns_ = step_ns;
    longest_at_ = rows_;
  }
  const std::int64_t bin = (step_ns + kBin / 2) / kBin;
  if (const auto found = steps_.find(bin); found != steps_.end() || steps_.size() < kMostBins) {
    Bin& entry = steps_[bin];
    ++entry.count;
    entry.sum += static_cast<double>(step_ns);
  }
  add_to_pattern(step_ns);
}

void SamplingReport::add_to_pattern(std::int64_t step_ns) {
  const auto ago = [&](std::size_t lag) { return recent_[(step_count_ - lag) % kRecent]; };
  recent_[step_count_ % kRecent] = step_ns;
  if (++step_count_ < kRecent) return;
  // ago(1) is the present step from here on.
  std::int64_t least = step_ns, most = step_ns;
  for (std::size_t i = 1; i <= kUnevenWindow; ++i) {
    least = std::min(least, ago(i));
    most = std::max(most, ago(i));
  }
  if (like(least, most)) return;
  ++uneven_;
  for (std::size_t lag = 2; lag <= kLongestPattern; ++lag) {
    if (!like(step_ns, ago(lag + 1))) {
      run_[lag] = 0;
      continue;
    }
    ++matches_[lag];
    if (++run_[lag] == 2 * lag && seen_[lag].empty())
      for (std::size_t i = lag; i >= 1; --i) seen_[lag].push_back(ago(i));
  }
}

void SamplingReport::add_values(const Sample& sample, double dt) {
  std::array<bool, kChannels> changed{};
  for (std::size_t c = 0; c < kChannels; ++c) {
    const double now = component(sample, c);
    channels_[c].finite = channels_[c].finite || std::isfinite(now);
    changed[c] = now != component(before_, c) && std::isfinite(now);
  }
  const bool moves = changed[0] || changed[1] || changed[2];

  for (std::size_t i = 0; i < kVectors && moves; ++i) {
    const Vec3& now = sample.*haptrace::kVectors.at(i);
    if (!is_finite(now)) continue;
    ++vectors_[i].moved;
    vectors_[i].time += dt;
    if (now == before_.*haptrace::kVectors.at(i) && !now.isZero(0)) ++vectors_[i].held;
  }

  for (std::size_t c = 0; c < kChannels; ++c) {
    Channel& channel = channels_[c];
    if (changed[c]) {
      ++channel.changes;
      ++channel.steps;
      const double change = component(sample, c) - component(before_, c);
      if (channel.run > 0 && channel.run_start == channel.longest_start)
        channel.longest_jump = std::max(channel.longest_jump, std::abs(change));
      if (std::isfinite(change)) {
        // Rounding also reverses the sign, but by next to nothing.
        const double smaller = std::min(std::abs(change), std::abs(channel.last_change));
        if (change * channel.last_change < 0 &&
            smaller * smaller * static_cast<double>(channel.changes) > 1e-6 * channel.change_sum)
          ++channel.turns;
        channel.last_change = change;
        channel.change_sum += change * change;
      }
      channel.run = 0;
      continue;
    }
    const std::size_t first = c - c % 3;
    const bool rests = first == 3 && component(sample, c) == 0 && !changed[c - 3];  // as its position does
    if (rests) continue;
    if (!moves && !changed[first] && !changed[first + 1] && !changed[first + 2]) continue;
    ++channel.steps;
    if (channel.run++ == 0) channel.run_start = before_.time_ns;
    if (channel.run > channel.longest_run) {
      channel.longest_run = channel.run;
      channel.longest_start = channel.run_start;
      channel.longest_end = sample.time_ns;
      channel.longest_jump = std::abs(channel.last_change);
    }
  }

  const Vec3 said = 0.5 * dt * (sample.velocity + before_.velocity), moved = sample.position - before_.position;
  if (!(dt > 0) || !is_finite(said) || !is_finite(moved)) return;
  follow_stops(said, moved);
  ++motion_rows_;
  moved_moved_ += moved.squaredNorm();
  moved_said_ += moved.dot(said);
  said_said_ += said.squaredNorm();
}

void SamplingReport::follow_stops(const Vec3& said, const Vec3& moved) {
  constexpr double kAgrees = 0.5;  // least share of a jump, and of what the velocity said, that the other makes up
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    Stop& stop = stops_.at(static_cast<std::size_t>(axis));
    if (stop.steps == 0) stop.start = before_.time_ns, stop.said = 0;
    stop.said += said[axis];
    if (moved[axis] == 0) {
      ++stop.steps;
      continue;
    }
    const double jump = moved[axis] * (stop.said < 0 ? -1 : 1);
    const double way = std::abs(stop.said);
    if (stop.steps >= kFew && jump > kAgrees * way && way > kAgrees * jump && jump > stop.longest_jump) {
      stop.longest_jump = jump;
      stop.longest_start = stop.start;
      stop.longest_end = before_.time_ns;
    }
    stop.steps = 0;
  }
}

void SamplingReport::find_pattern(Sampling& result) const {
  constexpr double kMostly = 0.75, kAsGood = 0.03;
  const auto share = [&](std::size_t lag) { return static_cast<double>(matches_[lag]) / static_cast<double>(uneven_); };
  if (uneven_ < kFew) return;
  double best = 0;
  for (std::size_t lag = 2; lag <= kLongestPattern; ++lag) best = std::max(best, share(lag));
  if (best < kMostly) return;
  std::size_t period = 2;
  while (share(period) < best - kAsGood) ++period;
  std::vector<std::int64_t> steps = seen_[period];
  if (steps.empty()) return;

  // Every rotation is the same pattern. Choose the largest of those that begin with the shortest step and do not end
  // with it.
  const auto differs = [](std::int64_t a, std::int64_t b) { return !like(a, b) && a < b; };
  std::vector<std::int64_t> chosen;
  for (std::size_t i = 0; i < period; ++i) {
    std::rotate(steps.begin(), steps.begin() + 1, steps.end());
    const std::int64_t least = *std::min_element(steps.begin(), steps.end());
    if (!like(steps.front(), least) || like(steps.back(), least)) continue;
    if (chosen.empty() ||
        std::lexicographical_compare(chosen.begin(), chosen.end(), steps.begin(), steps.end(), differs))
      chosen = steps;
  }
  for (const std::int64_t step : chosen) {
    Bin mean;  // of all steps of this kind: a single one is noisy
    for (const auto& [bin, entry] : steps_) {
      if (!like(bin * kBin, step)) continue;
      mean.count += entry.count;
      mean.sum += entry.sum;
    }
    result.pattern.push_back(1e-9 * mean.sum / static_cast<double>(mean.count));
  }
  const auto [least, most] = std::minmax_element(chosen.begin(), chosen.end());
  if (chosen.empty() || like(*least, *most)) return result.pattern.clear();  // noise: all steps are of one kind
  result.pattern_share = static_cast<double>(matches_[period]) / static_cast<double>(step_count_);
}

/// Finds the clock in the pattern, or otherwise in all steps.
void SamplingReport::find_clock(Sampling& result) {
  constexpr double kNearlyAll = 0.9, kEnough = 0.05;
  std::vector<std::pair<double, double>> steps;  // length, weight
  for (const double step : result.pattern) steps.emplace_back(step, 1.0 / static_cast<double>(result.pattern.size()));
  if (steps.empty()) steps = result.commonest;
  double base = 0;
  for (const auto& [step, share] : steps)
    if (share >= kEnough && (base == 0 || step < base)) base = step;
  if (base == 0) return;
  double rows = 0, ticks = 0, longer = 0;
  for (const auto& [step, share] : steps) {
    double multiple = 0;
    if (!is_multiple(step, base, multiple)) continue;
    rows += share;
    ticks += share * multiple;
    longer += multiple > 1 ? share : 0;
  }
  if (rows < kNearlyAll || longer < 0.02) return;
  result.clock_period = base;
  result.missing = 1 - rows / ticks;
}

/// Finds the median and the longest step, whether the steps are even, and the gaps.
void SamplingReport::find_steps(Sampling& result) const {
  std::uint64_t counted = 0, passed = 0;
  for (const auto& [bin, entry] : steps_) counted += entry.count;
  for (const auto& [bin, entry] : steps_) {
    passed += entry.count;
    if (2 * passed <= counted) continue;
    result.median_step = 1e-9 * entry.sum / static_cast<double>(entry.count);
    break;
  }
  result.longest_step = 1e-9 * static_cast<double>(longest_ns_);
  result.longest_at = longest_at_;
  result.even = 1e-9 * static_cast<double>(longest_ns_ - shortest_ns_) <= 0.01 * result.median_step;
  for (const auto& [bin, entry] : steps_)
    if (1e-9 * entry.sum / static_cast<double>(entry.count) > 5 * result.median_step) result.gaps += entry.count;
}

/// Finds the most frequent steps: the most frequent one absorbs its neighbours; then the most frequent of the rest does
/// the same.
void SamplingReport::find_commonest(Sampling& result) const {
  std::vector<std::pair<std::int64_t, Bin>> left(steps_.begin(), steps_.end());
  while (!left.empty() && result.commonest.size() < 16) {
    const auto top = std::max_element(left.begin(), left.end(), [](const auto& a, const auto& b) {
      return std::pair(a.second.count, a.first) < std::pair(b.second.count, b.first);
    });
    const double step = top->second.sum / static_cast<double>(top->second.count);
    Bin sum;
    std::erase_if(left, [&](const auto& each) {
      if (std::abs(each.second.sum / static_cast<double>(each.second.count) - step) > kSame * step) return false;
      sum.count += each.second.count;
      sum.sum += each.second.sum;
      return true;
    });
    result.commonest.emplace_back(1e-9 * sum.sum / static_cast<double>(sum.count),
                                  static_cast<double>(sum.count) / static_cast<double>(step_count_));
  }
  std::stable_sort(result.commonest.begin(), result.commonest.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
}

/// Returns true if nearly all steps are near the median, and nothing explains the others.
bool SamplingReport::is_steady(const Sampling& result) const {
  constexpr double kJitter = 0.5, kNearlyAll = 0.99;
  std::uint64_t near = 0;
  for (const auto& [bin, entry] : steps_)
    if (std::abs(1e-9 * static_cast<double>(bin * kBin) - result.median_step) <= kJitter * result.median_step)
      near += entry.count;
  return result.even || (static_cast<double>(near) >= kNearlyAll * static_cast<double>(step_count_) &&
                         result.gaps == 0 && result.pattern.empty() && result.clock_period == 0);
}

/// Finds the vectors that keep their value while the position moves.
void SamplingReport::find_held(Sampling& result) const {
  constexpr double kConstantSpeed = 10;  // new velocities per second, below which they are those of straight lines
  for (std::size_t i = 0; i < kVectors; ++i) {
    const Vector& vector = vectors_[i];
    if (5 * vector.held <= vector.moved) continue;
    const double rate = vector.time > 0 ? static_cast<double>(vector.moved - vector.held) / vector.time : 0;
    if (i == 0 && rate < kConstantSpeed && std::abs(result.motion_ratio - 1) <= kDisagrees) continue;
    result.held.push_back(
        {kVectorNames.at(i), static_cast<double>(vector.held) / static_cast<double>(vector.moved), rate});
  }
}

bool SamplingReport::jumps(const Channel& channel, double change) {
  return change > kJump * std::sqrt(channel.change_sum / static_cast<double>(channel.changes));
}

/// Finds the channels that never change, and those that stop while others change.
void SamplingReport::find_stuck(Sampling& result) const {
  constexpr double kLongEnough = 0.5, kLongStop = 0.1;  // [s]
  for (std::size_t c = 0; c < kChannels; ++c) {
    const Channel& channel = channels_[c];
    if (!channel.finite || channel.steps == 0) continue;
    if (channel.changes == 0) {
      result.constant.emplace_back(kChannelNames.at(c));
      continue;
    }
    if (c < 3) {
      const Stop& stop = stops_.at(c);
      const double lasted = 1e-9 * static_cast<double>(stop.longest_end - stop.longest_start);
      if (lasted >= kLongStop && jumps(channel, stop.longest_jump)) {
        result.stuck.push_back(
            {kChannelNames.at(c), 1e-9 * static_cast<double>(stop.longest_start - first_ns_), lasted});
        continue;
      }
    }
    const double stuck = 1e-9 * static_cast<double>(channel.longest_end - channel.longest_start);
    const std::uint64_t elsewhere = channel.steps - channel.longest_run;
    // A planned movement comes to rest along an axis and starts again without a jump; noise does not rest.
    const bool noisy = 4 * channel.turns > channel.changes;
    if (!noisy && !jumps(channel, channel.longest_jump)) continue;
    if (stuck >= kLongEnough && channel.longest_run >= kFew && 2 * channel.changes > elsewhere &&
        elsewhere > channel.longest_run / 10)
      result.stuck.push_back(
          {kChannelNames.at(c), 1e-9 * static_cast<double>(channel.longest_start - first_ns_), stuck});
  }
}

Sampling SamplingReport::result() const {
  Sampling result;
  result.rows = rows_;
  result.duplicates = duplicates_;
  result.backward = backward_;
  result.duration = 1e-9 * static_cast<double>(last_ns_ - first_ns_);
  if (result.duration > 0) result.mean_rate = static_cast<double>(rows_ - 1) / result.duration;
  find_steps(result);
  find_commonest(result);
  if (step_count_ >= kFew && !result.even) {
    find_pattern(result);
    find_clock(result);
  }
  result.steady = is_steady(result);
  constexpr std::uint64_t kEnoughRows = 100;
  constexpr double kCorrelated = 0.9;
  if (motion_rows_ >= kEnoughRows && moved_said_ > kCorrelated * std::sqrt(moved_moved_ * said_said_))
    result.motion_ratio = moved_said_ / said_said_;
  find_held(result);
  find_stuck(result);
  return result;
}

std::vector<std::string> notes(const Sampling& sampling, bool kept) {
  std::vector<std::string> notes;
  if (sampling.rows < 3) return notes;
  if (sampling.median_step >= 0.5 && sampling.rows > kFew)
    notes.push_back(fmt::format("the median step of time is {:.4g} s; is t in milliseconds? It was read as seconds",
                                sampling.median_step));
  if (sampling.duplicates + sampling.backward > 0)
    notes.push_back(
        fmt::format("{} time stamps equal the previous one, {} are before it", sampling.duplicates, sampling.backward));
  if (!sampling.steady) {
    std::vector<std::string> parts;
    for (std::size_t i = 0; i < std::min<std::size_t>(3, sampling.commonest.size()); ++i)
      parts.push_back(fmt::format("{} ms ({:.0f} %)", milliseconds(sampling.commonest[i].first),
                                  100 * sampling.commonest[i].second));
    std::string note = fmt::format("time stamps are uneven{}: {:.4g} Hz on average, commonest steps {}",
                                   kept ? " and kept as they are" : "", sampling.mean_rate, fmt::join(parts, ", "));
    if (!sampling.pattern.empty()) {
      std::vector<std::string> steps;
      for (const double step : sampling.pattern) steps.push_back(milliseconds(step));
      note += fmt::format("; in {:.0f} % of the samples they repeat {} ms", 100 * sampling.pattern_share,
                          fmt::join(steps, ", "));
    }
    if (sampling.clock_period > 0)
      note += fmt::format("; {} of a clock of {:.4g} Hz that lacks {:.0f} % of its ticks",
                          sampling.pattern.empty() ? "they are multiples" : "that is the pattern",
                          1 / sampling.clock_period, 100 * sampling.missing);
    if (sampling.gaps > 0)
      note += fmt::format("; {} gap{} longer than 5 median steps, the longest {:.4g} s before sample {}", sampling.gaps,
                          sampling.gaps > 1 ? "s" : "", sampling.longest_step, sampling.longest_at);
    notes.push_back(note);
  }
  for (const Sampling::Held& held : sampling.held)
    notes.push_back(
        fmt::format("the {} stays the same in {:.0f} % of the steps in which the position moves: its sensor is slower "
                    "than the samples, about {:.3g} new values a second",
                    held.name, 100 * held.share, held.rate));
  for (const Sampling::Stuck& stuck : sampling.stuck)
    notes.push_back(
        fmt::format("{} does not change for {:.3g} s from {:.3f} s on, while others do: was the sensor stuck?",
                    stuck.name, stuck.duration, stuck.from));
  if (std::abs(sampling.motion_ratio - 1) > kDisagrees)
    notes.push_back(fmt::format(
        "the position moves {:.3g} times as far as velocities and time stamps imply: at a mean rate of {:.4g} "
        "Hz instead of {:.4g} Hz they would agree",
        sampling.motion_ratio, sampling.mean_rate / sampling.motion_ratio, sampling.mean_rate));
  return notes;
}

nlohmann::json json_of(const Sampling& sampling) {
  nlohmann::json commonest = nlohmann::json::array(), held = commonest, stuck = commonest;
  for (const auto& [step, share] : sampling.commonest) commonest.push_back({{"step_s", step}, {"share", share}});
  for (const auto& each : sampling.held)
    held.push_back({{"name", each.name}, {"share", each.share}, {"rate_hz", each.rate}});
  for (const auto& each : sampling.stuck)
    stuck.push_back({{"name", each.name}, {"from_s", each.from}, {"duration_s", each.duration}});
  return {
      {"rows", sampling.rows},
      {"duration_s", sampling.duration},
      {"mean_rate_hz", sampling.mean_rate},
      {"median_step_s", sampling.median_step},
      {"even", sampling.even},
      {"steady", sampling.steady},
      {"commonest_steps", std::move(commonest)},
      {"pattern_s", sampling.pattern},
      {"pattern_share", sampling.pattern_share},
      {"clock_hz", sampling.clock_period > 0 ? 1 / sampling.clock_period : 0},
      {"clock_missing_share", sampling.missing},
      {"gaps", sampling.gaps},
      {"longest_step_s", sampling.longest_step},
      {"longest_step_before_row", sampling.longest_at},
      {"duplicates", sampling.duplicates},
      {"backward", sampling.backward},
      {"held", std::move(held)},
      {"constant", sampling.constant},
      {"stuck", std::move(stuck)},
      {"motion_ratio", std::isnan(sampling.motion_ratio) ? nlohmann::json() : nlohmann::json(sampling.motion_ratio)}};
}

}  // namespace haptrace
