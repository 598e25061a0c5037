// How well a repetition followed its reference.
#pragma once

#include "base/types.h"

#include <cstdint>
#include <nlohmann/json_fwd.hpp>

namespace haptrace {

/// Metrics of one repetition, over phase run.
struct TrackingFigures {
  std::uint64_t samples = 0;
  double duration = 0;               ///< without the time during which the device was away or returned to its place [s]
  double rms_error = 0;              ///< 3-D distance to the reference at the same instant [m]
  double peak_error = 0;             ///< [m]
  double force_ripple = 0;           ///< sent force above 25 Hz, rms [N]
  double max_force = 0;              ///< largest magnitude sent [N]
  double rms_rotation_error = kNaN;  ///< rms angle to the reference orientation [rad]; NaN without one
  double peak_rotation_error = kNaN;  ///< [rad]
};

nlohmann::json to_json(const TrackingFigures& figures);

}  // namespace haptrace
