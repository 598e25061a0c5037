#include "formats/recording/recording_summary.h"

#include "formats/recording/recording.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

constexpr std::int64_t kSpeedWindow = 10'000'000;  // [ns]

double to_seconds(std::int64_t ns) {
  return 1e-9 * static_cast<double>(ns);
}

}  // namespace

void RecordingSummary::join(const RecordingSummary& next) {
  if (next.rows == 0) return;
  if (rows == 0) {
    *this = next;
    return;
  }
  if (next.first_tick > last_tick + 1) {
    ++gaps;
    missed += next.first_tick - last_tick - 1;
  }
  gaps += next.gaps;
  missed += next.missed;
  longest_interval = std::max({longest_interval, next.longest_interval, to_seconds(next.first_ns - last_ns)});
  bounds.include(next.bounds);
  const double between = (next.first_position - last_position).norm();
  path_length += next.path_length + (std::isfinite(between) ? between : 0);
  peak_speed = std::max(peak_speed, next.peak_speed);
  max_force = std::max(max_force, next.max_force);
  with_velocity += next.with_velocity;
  with_force += next.with_force;
  without_position += next.without_position;

  runs += next.runs - (ends_in_run && next.begins_in_run ? 1 : 0);
  run_rows += next.run_rows;
  run_bounds.include(next.run_bounds);
  run_peak_speed = std::max(run_peak_speed, next.run_peak_speed);
  tracked += next.tracked;
  error2_sum += next.error2_sum;
  error2_peak = std::max(error2_peak, next.error2_peak);

  rows += next.rows;
  last_ns = next.last_ns;
  last_tick = next.last_tick;
  last_position = next.last_position;
  ends_in_run = next.ends_in_run;
}

double RecordingSummary::duration() const noexcept {
  return to_seconds(last_ns - first_ns);
}

double RecordingSummary::mean_rate() const noexcept {
  return last_ns > first_ns ? static_cast<double>(rows - 1) / duration() : 0;
}

double RecordingSummary::rms_error() const noexcept {
  return tracked > 0 ? std::sqrt(error2_sum / static_cast<double>(tracked)) : kNaN;
}

double RecordingSummary::peak_error() const noexcept {
  return tracked > 0 ? std::sqrt(error2_peak) : kNaN;
}

void Summariser::add(std::span<const Sample> samples) {
  if (samples.empty()) return;
  if (summary_.rows == 0) begin(samples.front());
  // Handle stretches of one phase, so that the loop only does the work that all rows need.
  while (!samples.empty()) {
    const bool run = samples.front().phase == Phase::run;
    const auto end = std::find_if(samples.begin(), samples.end(),
                                  [&](const Sample& sample) { return (sample.phase == Phase::run) != run; });
    const auto rows = static_cast<std::size_t>(end - samples.begin());
    const Box bounds = add_stretch(samples.first(rows), run);
    if (run) {
      summary_.run_bounds.include(bounds);
      summary_.run_rows += rows;
      summary_.runs += summary_.ends_in_run ? 0 : 1;
    }
    summary_.ends_in_run = run;
    samples = samples.subspan(rows);
  }
}

/// Begins a block as if its first row had come before as well: no gap, no distance, no interval.
void Summariser::begin(const Sample& first) {
  summary_.first_ns = summary_.last_ns = first.time_ns;
  summary_.first_tick = summary_.last_tick = first.tick;
  summary_.first_position = summary_.last_position = first.position;
  summary_.begins_in_run = first.phase == Phase::run;
}

Box Summariser::add_stretch(std::span<const Sample> samples, bool run) {
  // Values that every row changes stay in registers in the loop.
  Box bounds;
  double path_length = summary_.path_length, max_force2 = max_force2_;
  std::int64_t last_ns = summary_.last_ns, longest_ns = longest_ns_;
  std::uint64_t last_tick = summary_.last_tick, with_velocity = 0, with_force = 0;
  Vec3 last_position = summary_.last_position;
  window_.in_run = window_.in_run && run;
  for (const Sample& sample : samples) {
    if (sample.tick > last_tick + 1) {
      ++summary_.gaps;
      summary_.missed += sample.tick - last_tick - 1;
    }
    last_tick = sample.tick;
    longest_ns = std::max(longest_ns, sample.time_ns - last_ns);
    last_ns = sample.time_ns;
    const double step = (sample.position - last_position).norm();
    last_position = sample.position;
    if (std::isfinite(step)) {
      path_length += step;
      bounds.include(sample.position);
    } else if (is_finite(sample.position)) {
      bounds.include(sample.position);
    } else {
      ++summary_.without_position;
    }
    with_velocity += std::isfinite(sample.velocity.squaredNorm()) ? 1 : 0;
    const double force2 = sample.force.squaredNorm();
    if (std::isfinite(force2)) {
      ++with_force;
      max_force2 = std::max(max_force2, force2);
    }
    if (run && !std::isnan(sample.reference_position.x())) add_error(sample);
    const std::int64_t elapsed = sample.time_ns - window_.time_ns;
    if (!window_.known || elapsed >= kSpeedWindow || elapsed < 0) measure_speed(sample);
  }
  summary_.rows += samples.size();
  summary_.bounds.include(bounds);
  summary_.path_length = path_length;
  summary_.last_ns = last_ns;
  summary_.last_tick = last_tick;
  summary_.last_position = last_position;
  summary_.with_velocity += with_velocity;
  summary_.with_force += with_force;
  max_force2_ = max_force2;
  longest_ns_ = longest_ns;
  return bounds;
}

void Summariser::add_error(const Sample& sample) {
  const double error2 = (sample.position - sample.reference_position).squaredNorm();
  if (!std::isfinite(error2)) return;
  ++summary_.tracked;
  summary_.error2_sum += error2;
  summary_.error2_peak = std::max(summary_.error2_peak, error2);
}

void Summariser::measure_speed(const Sample& sample) {
  const double speed = (sample.position - window_.position).norm() / to_seconds(sample.time_ns - window_.time_ns);
  if (std::isfinite(speed)) {
    summary_.peak_speed = std::max(summary_.peak_speed, speed);
    if (window_.in_run) summary_.run_peak_speed = std::max(summary_.run_peak_speed, speed);
  }
  window_ = {sample.time_ns, sample.position, is_finite(sample.position), sample.phase == Phase::run};
}

RecordingSummary Summariser::take() {
  summary_.max_force = std::sqrt(std::exchange(max_force2_, 0));
  summary_.longest_interval = to_seconds(std::exchange(longest_ns_, 0));
  return std::exchange(summary_, {});
}

RecordingSummary summarise(const RecordingReader& reader, const std::function<void(std::uint64_t)>& progress) {
  RecordingSummary whole;
  for (const RecordingSummary& block : reader.overview(progress)) whole.join(block);
  return whole;
}

}  // namespace haptrace
