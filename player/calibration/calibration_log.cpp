#include "player/calibration/calibration_log.h"

#include "control/design/saturation_identification.h"

#include <utility>

namespace haptrace {

CalibrationLog::CalibrationLog(const CalibrationController& controller, std::size_t rows) : controller_(controller) {
  rows_.reserve(rows);
  dithered_.reserve(4);
  for (auto& axis : sweeps_) axis.reserve(4);
  for (auto& axis : pulsed_) axis.reserve(1);
}

void CalibrationLog::push(const Sample& sample) noexcept {
  const TickRow row{1e-9 * static_cast<double>(sample.time_ns), sample.position, sample.force};
  bridge(row, sample.tick - std::exchange(tick_, sample.tick));
  if (rows_.size() == rows_.capacity()) return;
  rows_.push_back(row);
  const bool measures = controller_.measures();
  const CalibrationController::Stage stage = controller_.stage();
  const bool along_axis = stage == CalibrationController::Stage::sweep || stage == CalibrationController::Stage::pulse;
  const int axis = along_axis ? controller_.axis() : -1;
  if (!measures) {
    open_ = nullptr;
    return;
  }
  if (stage == CalibrationController::Stage::place) {
    const std::size_t place = controller_.place();
    if (place >= kMostPlaces) return;
    if (places_end_[place] == 0) places_begin_[place] = rows_.size() - 1;
    places_end_[place] = rows_.size();
    return;
  }
  if (open_ == nullptr || axis != axis_) {
    auto& of_axes = stage == CalibrationController::Stage::pulse ? pulsed_ : sweeps_;
    std::vector<Stretch>& list = axis < 0 ? dithered_ : of_axes[static_cast<std::size_t>(axis)];
    if (list.size() == list.capacity()) return;
    list.push_back({rows_.size() - 1, rows_.size()});
    open_ = &list.back();
    axis_ = axis;
  }
  open_->end = rows_.size();
}

Experiment CalibrationLog::experiment(const CalibrationPlan& plan) const {
  std::vector<ExperimentPlace> places;
  const auto whole = static_cast<std::size_t>(0.95 * plan.dither.period() * plan.rate_hz);  // of rows
  for (std::size_t i = 0; i < plan.places.size(); ++i)
    if (places_end_[i] >= places_begin_[i] + whole)
      places.push_back({plan.places[i], {places_begin_[i], places_end_[i]}});
  return {.rows = rows_,
          .rate_hz = plan.rate_hz,
          .axes = plan.axes,
          .dither = &plan.dither,
          .dithered = dithered_,
          .centre = plan.centre,
          .places = std::move(places),
          .sweeps = sweeps_,
          .pulsed = pulsed_};
}

Experiment CalibrationLog::whole(const CalibrationPlan& plan) const {
  return {.rows = rows_,
          .rate_hz = plan.rate_hz,
          .axes = plan.axes,
          .dither = nullptr,
          .dithered = {{0, rows_.size()}},
          .centre = plan.centre,
          .places = {},
          .sweeps = {},
          .pulsed = {}};
}

void CalibrationLog::bridge(const TickRow& next, std::uint64_t ticks) {
  if (rows_.empty() || ticks > kBridged) return;
  const TickRow last = rows_.back();
  for (std::uint64_t k = 1; k < ticks && rows_.size() < rows_.capacity(); ++k) {
    const double share = static_cast<double>(k) / static_cast<double>(ticks);
    rows_.push_back({last.time + share * (next.time - last.time),
                     last.position + share * (next.position - last.position), last.force});
  }
}

}  // namespace haptrace
