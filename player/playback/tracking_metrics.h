// How well a session followed its reference, measured while it runs.
#pragma once

#include "control/ripple.h"
#include "control/sample.h"

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

namespace haptrace {

/// The figures of one repetition, over phase run.
struct TrackingFigures {
  std::uint64_t samples = 0;
  double duration = 0;                ///< without the time that a device was away and back on its way [s]
  double rms_error = 0;               ///< 3-D, position against the reference at the same instant [m]
  double peak_error = 0;              ///< [m]
  double force_ripple = 0;            ///< rms of the sent force above 25 Hz [N]
  double max_force = 0;               ///< largest magnitude sent [N]
  double rms_rotation_error = kNaN;   ///< of the orientation against its reference; NaN without one [rad]
  double peak_rotation_error = kNaN;  ///< [rad]
};

/// Accumulates figures per repetition. The ripple is that of the sent force above 25 Hz; its filter follows every phase
/// so that it is settled when run begins.
///
/// Real-time: push. Memory for `repetitions` is taken at construction; of further ones only the last is kept.
class TrackingMetrics final : public SampleSink {
 public:
  static constexpr double kRippleCutoff = 25;  // [Hz]

  TrackingMetrics(double rate_hz, std::size_t repetitions);

  void push(const Sample& sample) noexcept override;
  void push(const Event& event) noexcept override;

  /// Every repetition that ran, in order.
  [[nodiscard]] std::vector<TrackingFigures> repetitions() const;
  /// The last repetition's; all zero when none ran.
  [[nodiscard]] TrackingFigures last() const;

 private:
  struct Sums {
    std::uint64_t samples = 0;
    std::int64_t run_ns = 0;  ///< from row to row
    double error2 = 0, peak2 = 0, ripple2 = 0, force2 = 0;
    std::uint64_t turned = 0;  ///< samples with an orientation and a reference for it
    double rotation2 = 0, peak_rotation2 = 0;
  };
  static TrackingFigures figures(const Sums& sums);

  std::vector<Sums> sums_;
  std::optional<std::int64_t> last_ns_;  ///< the time of the last row that counted, unless a gap followed
  Ripple ripple_;
};

nlohmann::json to_json(const TrackingFigures& figures);

}  // namespace haptrace
