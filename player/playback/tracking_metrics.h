// Tracking metrics of a session, computed while it runs.
#pragma once

#include "control/ripple.h"
#include "control/sample.h"
#include "player/playback/tracking_figures.h"

#include <optional>
#include <vector>

namespace haptrace {

/// Accumulates metrics per repetition. The filter of the force ripple runs in every phase, so that it has settled when
/// phase run begins.
///
/// Real-time: push. The constructor reserves memory for `repetitions`; of further ones only the last is kept.
class TrackingMetrics final : public SampleSink {
 public:
  TrackingMetrics(double rate_hz, std::size_t repetitions);

  void push(const Sample& sample) noexcept override;
  void push(const Event& event) noexcept override;

  /// Returns the metrics of every repetition that ran, in order.
  [[nodiscard]] std::vector<TrackingFigures> repetitions() const;
  /// Returns the number of repetitions before other feedback replaced one that vibrated; nothing if none did.
  [[nodiscard]] std::optional<std::size_t> renewed_after() const noexcept { return renewed_after_; }
  /// Returns the metrics of the last repetition; defaults if none ran.
  [[nodiscard]] TrackingFigures last() const;

 private:
  struct Sums {
    std::uint64_t samples = 0;
    std::int64_t run_ns = 0;  ///< sum of the intervals between samples
    double error2 = 0, peak2 = 0, ripple2 = 0, force2 = 0;
    std::uint64_t turned = 0;  ///< samples with a finite orientation and a reference for it
    double rotation2 = 0, peak_rotation2 = 0;
  };
  static TrackingFigures figures(const Sums& sums);

  std::vector<Sums> sums_;
  std::size_t begun_ = 0;  ///< number of repetitions
  std::optional<std::size_t> renewed_after_;
  std::optional<std::int64_t> last_ns_;  ///< time of the last counted sample, unless a gap followed
  Ripple ripple_;
};

}  // namespace haptrace
