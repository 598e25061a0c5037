// The force of an expert's recording that a trainee shall feel: the task's, without the expert's own device.
#pragma once

#include "control/design/plant_model.h"
#include "control/inertia_map.h"
#include "formats/path/path_source.h"

#include <memory>
#include <optional>

namespace haptrace {

/// Cut-off of the zero-phase low pass of measured forces, and of the positions that are differentiated beside them
/// [Hz]. Within 10 to 20 Hz: a hand's forces are below, and noise of the second derivative is above.
inline constexpr double kExpertForceCutoff = 15;

/// Longest gap between two samples across which a movement can be differentiated [s].
inline constexpr double kLongestForceGap = 0.1;

/// Force of the device that is subtracted from a force measured at the handle.
struct HandleForce {
  PlantModel plant;                   ///< of the expert's device; zero: nothing is subtracted
  std::optional<InertiaMap> inertia;  ///< factors on its mass
  bool negated = false;               ///< the sensor tells the force of the hand on the device
};

/// Returns `path` with the force of the task in place of the measured force. A handle's sensor measures the force on
/// the hand:
///
///     F_hand = F_task - (m a + b v + R^T F_c tanh(R v / v_0)) + gravity + gradient x + cogging(x)
///
/// in which F_task is the force of the world and the commanded force of the device, such as that of a scene. F_hand
/// and x are low-passed (kExpertForceCutoff), so that all terms have the same bandwidth; so are the friction and the
/// cogging, with R as in FrictionFeedforward and v_0 = 2 mm/s. Without a plant, only the low pass remains. Forces that
/// depend on speed are those of the expert's speed.
///
/// `path` must hold the measured force (PathSelection::measured) and have no gap above kLongestForceGap. Rows are read
/// with a margin, so that pieces agree to 1e-9 of the force; memory is that of a piece. Throws Error(input) naming the
/// path if it has no force or too long a gap.
std::shared_ptr<const PathSource> task_force(std::shared_ptr<const PathSource> path, const HandleForce& handle);

/// Findings about the sensor of a recording and the expert's task.
struct ForceSurvey {
  double path_length = 0, displacement = 0;  ///< of the rows in which the device sent no force [m]
  double work = 0;                           ///< of the measured force on the hand in those rows [J]
  double effort = 0;  ///< the same, with the magnitude of the force and every step counted as positive [J]
  double noise = 0;   ///< of the measured force within the pass band, rms of the magnitude [N]
  /// Magnitude of the inertia and friction of the expert's device, 99th percentile [N]. Its weight is not among them:
  /// it is constant, and known better.
  double drag = 0;
  /// Magnitude of the rest, without what dry friction can hold along axes at rest, 99th percentile [N].
  double task = 0;

  /// Returns true if the measured force drove the hand in free movement: a device's drag takes energy from the hand, so
  /// the sensor's sign is reversed. A movement in one direction is not judged, because the device's weight may drive
  /// it.
  [[nodiscard]] bool drives_the_hand() const noexcept;
  /// Returns true if the rest is within the error of the measurement and of the model: three times the noise, or a
  /// quarter of the drag.
  [[nodiscard]] bool only_the_device() const noexcept;
};

/// Surveys a recording. `sent` and `measured` are the same rows, with the sent force (all zero if it has none) and with
/// the measured force. Reads all rows. Throws what task_force() throws.
ForceSurvey survey_forces(const PathSource& sent, const std::shared_ptr<const PathSource>& measured,
                          const HandleForce& handle);

}  // namespace haptrace
