// The trials of a calibration's laws on the device itself.
#pragma once

#include "player/calibration/calibration.h"
#include "player/calibration/calibration_plan.h"

#include <vector>

namespace haptrace {

/// Ends a calibration after its first session: there is no profile then.
void end_early(StopCause cause, const std::string& reason, CalibrationResult& result);

/// Finds a design for a coarse model under which the device is stable, and notes in the result what came of it: the
/// last one with a verdict that refuses it if none is.
void try_designs(Device& device, const CalibrationPlan& plan, const SessionOptions& session, const StopRequest& stop,
                 const Progress& progress, CalibrationResult& result);

/// Tries the laws beside plain PD control at the centre and at `places` that the device reached before, and notes in
/// the result what came of it. An LQG law that fails is designed again for a mass that differs more; if that fails too,
/// the softer ones are tried. For a coarse model, what playbacks use must be the closest in the trials: plain PD
/// control with or without feedforward, the law with an observer, or an LQG law. There, small oscillations do not
/// count, which every stiff loop has within a backlash. Returns early if the user or the device ends it.
void try_laws(Device& device, const CalibrationPlan& plan, const std::vector<ExperimentPlace>& places,
              const CalibrationOptions& options, const StopRequest& stop, const Progress& progress,
              CalibrationResult& result);

}  // namespace haptrace
