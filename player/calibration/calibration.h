// Calibration of a device: a session that moves the device and identifies its dynamics.
#pragma once

#include "control/design/identified_device.h"
#include "control/design/saturation_identification.h"
#include "player/session.h"

#include <functional>
#include <optional>
#include <string>

namespace haptrace {

struct CalibrationOptions {
  bool full = false;         ///< measures at the centre for half a minute instead of ten seconds
  bool places = true;        ///< measures around the centre too, and tries the laws there: about a minute more
  double force_share = 0.7;  ///< force bound, as a share of the device's largest force, 0.1 to 1
  bool laws = true;          ///< search LQG laws after the session, which takes seconds
  std::function<void(double)> searching;  ///< receives the share of the search that is done, in the calling thread
  SessionOptions session;
};

struct CalibrationResult {
  SessionResult session;
  MotorLimit motors;                     ///< largest force of the motors, from the last session that finished
  Identification identification;         ///< model from the recorded data; `fits` is false when the data do not suffice
  std::optional<TrackingDesign> design;  ///< present when the session finished and the model fits
  std::string reason;                    ///< why there is no design; empty when there is one
  std::string doubt;                     ///< why the model is only a coarse one; empty for a full model
  double bandwidth = 1;                  ///< share of the designed bandwidth that passed; 0: none; 1 without trials
  int trials = 0;                        ///< number of trials of a coarse model's design

  std::optional<HeldDevice> held;  ///< laws for the device in the hand; present for a full model

  [[nodiscard]] bool succeeded() const noexcept { return design.has_value(); }

  /// Returns what a session's law is designed from. Only after a calibration that succeeded.
  [[nodiscard]] IdentifiedDevice identified() const { return {identification.plant, design.value(), held}; }
};

/// Moves the device to the middle of its workspace and swings it round while an excitation signal of many frequencies
/// acts on the force; the response yields mass and delay. Then sweeps the device along each axis to identify friction
/// and gravity. With `places`, strokes under pulses of force that grow follow: they show whether the motors saturate
/// below the force that the device states. If so, what follows stays below that, and the model and the laws are those
/// for the force that acts. A first look at the response checks that the device moves in the direction of the force and
/// sets the gains and the amplitude of the excitation for the rest. The plan bounds forces, speed and distances. The
/// session ends early when the device is blocked, pushed away or driven in the wrong direction.
///
/// If the response is not that of a mass, identify_coarsely makes a coarse model. The law with an observer for it is
/// then tried out on a circle within the same bounds (law_trial.h) at 1, 0.7, 0.5 and 0.35 of its bandwidth, and the
/// first that passes is kept. If no law passes its trials, playbacks take plain PD control, which must stay calm over
/// the workspace; else the result has no design.
///
/// LQG laws are searched, and tried over the workspace beside plain PD control (workspace_trial.h); `held` says what
/// came of it. The calibration needs to know only the device's largest force,
/// workspace and axes beforehand.
///
/// Throws what plan_calibration and run_session throw before any force.
CalibrationResult calibrate(Device& device, const CalibrationOptions& options, const StopRequest& stop,
                            const Progress& progress = {});

}  // namespace haptrace
