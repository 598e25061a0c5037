// One trial with a cue and a device: plan, and session.
#pragma once

#include "control/design/identified_device.h"
#include "player/programme/reach_controller.h"
#include "player/session.h"

#include <optional>
#include <string>
#include <vector>

namespace haptrace {

class LiveGuidance;

struct ReachOptions {
  ReachTrial trial;
  bool locked = false;  ///< press: the handle is locked mechanically, so that no force holds it
  ReachCourse course;
  std::optional<double> clamp_stiffness;  ///< [N/m]; absent: the largest stable one
  double clamp_damping = 3;               ///< [N s/m]
  double break_out = 0.03;                ///< [m]
  double energy = 0.5;                    ///< [J], see ReachForces
  double shortest_start_hold = 0.5;       ///< of all reaches: time in which a clamp comes on, if it is at most 1.5 s
  std::optional<IdentifiedDevice> identified;
  SessionOptions session;
  std::vector<SampleSink*> sinks;  ///< borrowed
  LiveGuidance* live = nullptr;    ///< borrowed, may be null: its requests are obeyed
};

/// A reach that was checked against a device.
struct ReachPlan {
  ReachTrial trial;  ///< with what the device decides: workspace, largest force
  ReachForces::Options forces;
  std::vector<std::string> notes;     ///< messages for the user
  std::vector<std::string> warnings;  ///< messages that matter more
};

/// Throws Error(input) if the device cannot hold a press in this direction, or measure one against a locked handle.
void check_press(const DeviceInfo& device, const Vec3& direction, bool locked);

/// Checks a reach against the device before a force is sent. Throws Error(input).
ReachPlan plan_reach(const DeviceInfo& device, const ReachOptions& options);

/// Runs one reach. Throws what run_session() throws.
SessionResult reach(Device& device, const ReachPlan& plan, const ReachOptions& options, const StopRequest& stop,
                    const Progress& progress = {});

}  // namespace haptrace
