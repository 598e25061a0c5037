#include "formats/recording_summary.h"

#include "formats/recording.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace haptrace {
namespace {

constexpr std::int64_t kSpeedWindow = 10'000'000;  // [ns]

double seconds(std::int64_t ns) {
  return 1e-9 * static_cast<double>(ns);
}

void include(Box& box, const Box& other) {
  box.min = box.min.cwiseMin(other.min);
  box.max = box.max.cwiseMax(other.max);
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
  longest_interval = std::max({longest_interval, next.longest_interval, seconds(next.first_ns - last_ns)});
  include(bounds, next.bounds);
  const double between = (next.first_position - last_position).norm();
  path_length += next.path_length + (std::isfinite(between) ? between : 0);
  peak_speed = std::max(peak_speed, next.peak_speed);
  max_force = std::max(max_force, next.max_force);
  with_velocity += next.with_velocity;
  with_force += next.with_force;
  without_position += next.without_position;

  runs += next.runs - (ends_in_run && next.begins_in_run ? 1 : 0);
  run_rows += next.run_rows;
  include(run_bounds, next.run_bounds);
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
  return seconds(last_ns - first_ns);
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
  for (const Sample& sample : samples) {
    if (summary_.rows == 0)
      begin(sample);
    else
      follow(sample);
    measure_speed(sample);

    const bool run = sample.phase == Phase::run;
    ++summary_.rows;
    summary_.last_ns = sample.time_ns;
    summary_.last_tick = sample.tick;
    summary_.last_position = sample.position;
    summary_.ends_in_run = run;
    if (is_finite(sample.position)) {
      summary_.bounds.include(sample.position);
      if (run) summary_.run_bounds.include(sample.position);
    } else {
      ++summary_.without_position;
    }
    if (run) {
      ++summary_.run_rows;
      const double error2 = (sample.position - sample.reference_position).squaredNorm();
      if (std::isfinite(error2)) {
        ++summary_.tracked;
        summary_.error2_sum += error2;
        summary_.error2_peak = std::max(summary_.error2_peak, error2);
      }
    }
    if (is_finite(sample.velocity)) ++summary_.with_velocity;
    if (is_finite(sample.force)) {
      ++summary_.with_force;
      summary_.max_force = std::max(summary_.max_force, sample.force.norm());
    }
  }
}

void Summariser::begin(const Sample& sample) {
  const bool run = sample.phase == Phase::run;
  summary_.first_ns = sample.time_ns;
  summary_.first_tick = sample.tick;
  summary_.first_position = sample.position;
  summary_.begins_in_run = run;
  summary_.runs = run ? 1 : 0;
}

void Summariser::follow(const Sample& sample) {
  if (sample.tick > summary_.last_tick + 1) {
    ++summary_.gaps;
    summary_.missed += sample.tick - summary_.last_tick - 1;
  }
  summary_.longest_interval = std::max(summary_.longest_interval, seconds(sample.time_ns - summary_.last_ns));
  const double step = (sample.position - summary_.last_position).norm();
  if (std::isfinite(step)) summary_.path_length += step;
  if (sample.phase == Phase::run && !summary_.ends_in_run) ++summary_.runs;
}

void Summariser::measure_speed(const Sample& sample) {
  const bool run = sample.phase == Phase::run;
  window_in_run_ = window_in_run_ && run;
  const std::int64_t elapsed = sample.time_ns - window_ns_;
  if (elapsed < kSpeedWindow && elapsed >= 0 && is_finite(window_position_)) return;
  const double speed = (sample.position - window_position_).norm() / seconds(elapsed);
  if (std::isfinite(speed)) {
    summary_.peak_speed = std::max(summary_.peak_speed, speed);
    if (window_in_run_) summary_.run_peak_speed = std::max(summary_.run_peak_speed, speed);
  }
  window_ns_ = sample.time_ns;
  window_position_ = sample.position;
  window_in_run_ = run;
}

RecordingSummary Summariser::take() {
  return std::exchange(summary_, {});
}

RecordingSummary summarise(const RecordingReader& reader, const std::function<void(std::uint64_t)>& progress) {
  RecordingSummary whole;
  for (const RecordingSummary& block : reader.overview(progress)) whole.join(block);
  return whole;
}

}  // namespace haptrace
