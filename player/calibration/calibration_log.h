// The samples of a calibration, and which of them belong to which measurement.
#pragma once

#include "control/design/identification.h"
#include "control/sample.h"
#include "player/calibration/calibration_controller.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace haptrace {

/// Stores the samples of a session and the ranges that belong to each measurement.
///
/// Real-time: push.
class CalibrationLog final : public SampleSink {
 public:
  CalibrationLog(const CalibrationController& controller, std::size_t rows);

  using SampleSink::push;
  void push(const Sample& sample) noexcept override;

  [[nodiscard]] Experiment experiment(const CalibrationPlan& plan) const;

  /// See shorten_forces().
  void shorten(double limit) { shorten_forces(rows_, limit); }

  /// Returns an experiment of all recorded samples, for a session that ended early.
  [[nodiscard]] Experiment whole(const CalibrationPlan& plan) const;

 private:
  static constexpr std::uint64_t kBridged = 4;  ///< longest distance between two samples that is filled [ticks]

  /// Fills the few ticks before `next` that had no new sample or were missed: holds the last force and interpolates the
  /// position linearly.
  void bridge(const TickRow& next, std::uint64_t ticks);

  const CalibrationController& controller_;
  std::uint64_t tick_ = 0;  ///< tick of the last sample
  std::vector<TickRow> rows_;
  std::vector<Stretch> dithered_;
  std::array<std::vector<Stretch>, 3> sweeps_, pulsed_;
  static constexpr std::size_t kMostPlaces = 9;
  std::array<std::size_t, kMostPlaces> places_begin_{}, places_end_{};  ///< rows
  Stretch* open_ = nullptr;
  int axis_ = -1;
};

}  // namespace haptrace
