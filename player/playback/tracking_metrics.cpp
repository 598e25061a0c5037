#include "player/playback/tracking_metrics.h"

#include "control/rotation.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace haptrace {

TrackingMetrics::TrackingMetrics(double rate_hz, std::size_t repetitions) : ripple_(kRippleCutoff, rate_hz) {
  sums_.reserve(std::max<std::size_t>(repetitions, 1));
}

void TrackingMetrics::push(const Event& event) noexcept {
  if (event.code == EventCode::device_found || event.code == EventCode::states_resumed) last_ns_.reset();
  if (event.code == EventCode::feedback_renewed && !renewed_after_) renewed_after_ = begun_;
  if (event.code != EventCode::repetition) return;
  ++begun_;
  if (sums_.size() < sums_.capacity())
    sums_.emplace_back();
  else
    sums_.back() = {};
  last_ns_.reset();
}

void TrackingMetrics::push(const Sample& sample) noexcept {
  const double ripple2 = ripple_.update(sample.force);
  if (sample.phase != Phase::run || sums_.empty()) return;

  Sums& sums = sums_.back();
  if (last_ns_) sums.run_ns += sample.time_ns - *last_ns_;
  last_ns_ = sample.time_ns;
  ++sums.samples;
  const double error2 = (sample.position - sample.reference_position).squaredNorm();
  sums.error2 += error2;
  sums.peak2 = std::max(sums.peak2, error2);
  sums.ripple2 += ripple2;
  sums.force2 = std::max(sums.force2, sample.force.squaredNorm());
  if (is_finite(sample.reference_orientation) && is_finite(sample.orientation)) {
    const double rotation2 = rotation_between(sample.orientation, sample.reference_orientation).squaredNorm();
    ++sums.turned;
    sums.rotation2 += rotation2;
    sums.peak_rotation2 = std::max(sums.peak_rotation2, rotation2);
  }
}

TrackingFigures TrackingMetrics::figures(const Sums& sums) {
  if (sums.samples == 0) return {};
  const auto n = static_cast<double>(sums.samples);
  const bool turned = sums.turned > 0;
  return {.samples = sums.samples,
          .duration = 1e-9 * static_cast<double>(sums.run_ns),
          .rms_error = std::sqrt(sums.error2 / n),
          .peak_error = std::sqrt(sums.peak2),
          .force_ripple = std::sqrt(sums.ripple2 / n),
          .max_force = std::sqrt(sums.force2),
          .rms_rotation_error = turned ? std::sqrt(sums.rotation2 / static_cast<double>(sums.turned)) : kNaN,
          .peak_rotation_error = turned ? std::sqrt(sums.peak_rotation2) : kNaN};
}

std::vector<TrackingFigures> TrackingMetrics::repetitions() const {
  std::vector<TrackingFigures> result;
  for (const Sums& sums : sums_) result.push_back(figures(sums));
  return result;
}

TrackingFigures TrackingMetrics::last() const {
  return sums_.empty() ? TrackingFigures{} : figures(sums_.back());
}

nlohmann::json to_json(const TrackingFigures& figures) {
  nlohmann::json json{{"samples", figures.samples},
                      {"duration_s", figures.duration},
                      {"rms_error_m", figures.rms_error},
                      {"peak_error_m", figures.peak_error},
                      {"force_ripple_n", figures.force_ripple},
                      {"max_force_n", figures.max_force}};
  if (std::isfinite(figures.rms_rotation_error)) {
    json["rms_rotation_error_rad"] = figures.rms_rotation_error;
    json["peak_rotation_error_rad"] = figures.peak_rotation_error;
  }
  return json;
}

}  // namespace haptrace
