// haptrace in one header: sessions that record, play, guide and calibrate on any device, and their recordings.
//
//     const auto device = haptrace::open_device("sim:preset=falcon,hand=relaxed");
//     const haptrace::Path path = haptrace::make_shape("circle", {.size = 0.04, .duration = 2});
//     haptrace::PlayOptions options;
//     options.session.recording = haptrace::SessionOptions::Recording{.file = "played.h5"};
//     const auto plan = haptrace::plan_playback(device->info(), path, options);
//     const haptrace::PlayResult result = haptrace::play(*device, plan, options, haptrace::StopRequest{});
//
// The public headers are those that this header includes, directly or indirectly. Only they are installed.
#pragma once

#include "base/error.h"                      // Error: the one exception
#include "base/stop_request.h"               // StopRequest: ends a session from any thread
#include "control/controller.h"              // Controller: from state to force
#include "control/path/shapes.h"             // make_shape(): squares, circles and the like
#include "devices/device.h"                  // Device: what every driver implements
#include "devices/loop/servo_session.h"      // ServoOptions and ServoReport of the loop of every session
#include "devices/plugin.h"                  // the C interface of plug-ins
#include "devices/registry.h"                // open_device()
#include "formats/path/path_file.h"          // load_path(), open_path(), save_path()
#include "formats/recording/recording.h"     // RecordingReader and RecordingWriter
#include "metrics/movement.h"                // metrics of a movement
#include "player/calibration/calibration.h"  // calibrate()
#include "player/guidance/guide.h"           // guide()
#include "player/playback/playback.h"        // play()
#include "player/record.h"                   // record()
#include "player/session.h"                  // run_session(): runs a controller on a device
#include "recorder/recorded_devices.h"       // use_recorded_devices()
#include "scene/scene_file.h"                // load_scene(): objects that a hand can touch
#include "view/live_view.h"                  // LiveView: shows a session in a browser
#include "view/recording_view.h"             // RecordingView: shows recordings in a browser
