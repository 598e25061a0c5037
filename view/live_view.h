// The live view of a running session: a server for pages in a browser on this machine (docs/view-protocol.md).
#pragma once

#include "control/warning.h"
#include "devices/device.h"
#include "formats/recording/recording.h"
#include "player/session.h"
#include "view/view_role.h"

#include <chrono>
#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace haptrace {

class Annotations;
class Commands;
class HandSteering;
struct ShownObject;

/// Reaction to a page with control that falls silent.
enum class PageLost : std::uint8_t {
  soften,  ///< soften the feedback until the page is back
  stop,    ///< end the session, with the force fading out
  ignore,
};

PageLost parse_page_lost(std::string_view name);  ///< "soften" | "stop" | "ignore"; throws Error(input)
const char* to_string(PageLost reaction) noexcept;

/// Description of a session for the pages, besides its samples. NaN: unknown.
struct ViewedSession {
  std::string name, title, subject;
  std::string uuid;        ///< of the recording; may be empty
  std::string verb, mode;  ///< "guide", "tunnel"; may be empty
  std::string input;       ///< how a person moves a simulated hand, for example "mouse, depth from path"; empty if none
  DeviceInfo device;
  double rate_hz = 1000;
  bool virtual_time = false;
  RecordingColumns columns;                                         ///< of the session's samples
  double max_force = kNaN, max_deviation = kNaN, max_speed = kNaN;  ///< limits of the session [N, m, m/s]
  FollowedPath path;                                                ///< may be empty
};

/// Objects of a session that pages act on. All are borrowed, and any may be null.
struct ViewTargets {
  Commands* commands = nullptr;
  HandSteering* steering = nullptr;
  StopRequest* stop = nullptr;
  Annotations* annotations = nullptr;
};

/// Shows sessions to pages while they run, and lets pages act on them as far as this is allowed.
///
/// Every page can stop the session at once. Only pages of the therapist with Options::control can send commands. Only
/// with Options::steer can a page move the simulated hand, one page at a time.
///
/// Threads: all functions from one thread, except those of the sink, which the servo loop calls. Real-time: the sink.
class LiveView {
 public:
  struct Options {
    std::uint16_t port = 0;     ///< 0: any free port
    std::string token;          ///< of the therapist, 16 to 128 letters and digits; empty: a new one
    std::string trainee_token;  ///< of the trainee, likewise
    bool control = false;       ///< allow commands
    bool steer = false;         ///< allow a page to move the simulated hand
    PageLost on_page_lost = PageLost::soften;
    double page_patience = 2;  ///< silence after which a page counts as lost [s]
    /// Raised by a page's stop while no session runs, for example in a rest of a programme. Borrowed for the life of
    /// the view; may be null.
    StopRequest* stop_between = nullptr;
  };

  /// Listens on 127.0.0.1 and ::1. Throws Error(input): the port is taken, the token has other
  /// characters or another length, or the patience is not from 0.5 to 60 s.
  explicit LiveView(const Options& options);

  /// Closes all pages.
  ~LiveView();
  LiveView(const LiveView&) = delete;
  LiveView& operator=(const LiveView&) = delete;

  /// Returns the address to open, with the token of the role; empty for ViewRole::viewer, who looks at recordings.
  [[nodiscard]] std::string address(ViewRole role) const;

  /// Returns a sink for the session. It never waits in real time: samples that find its ring full are counted and not
  /// shown. In virtual time it waits between ticks for room.
  [[nodiscard]] SampleSink& sink() noexcept;

  /// Shows a session, or the next repetition of a programme, from now on. The targets are borrowed until end().
  void begin(const ViewedSession& session, const ViewTargets& targets);

  /// Sets the virtual scene of the sessions that begin from now on; none: no scene.
  void scene(const std::vector<ShownObject>& objects);

  /// Shows the status and the warnings of the running session. Call it from Progress.
  void show(const SessionView& view);

  /// Shows the result and lets go of the targets. Pages can still see what happened. With `more`, as after a repetition
  /// of a programme, another session follows: pages see no end, and the commands stay borrowed until over().
  void end(const SessionResult& result, bool more = false);

  /// Ends what `more` announced, and lets go of all targets. `reason` is that of a stop between two sessions; without
  /// one, pages keep that of the last session.
  void over(const std::string& reason = "");

  /// Ends a session that gave no result, for example because it threw. Does nothing if none is running.
  void abandon(const std::string& reason);

  /// Send the state of a programme or of a training to all pages, and to those that join later. `state` is the message
  /// of docs/view-protocol.md without its type.
  void programme(const nlohmann::json& state);
  void training(const nlohmann::json& state);

  /// Returns warnings since the last call, for SessionOptions::warnings. From any thread.
  [[nodiscard]] std::vector<Warning> warnings();

  /// Waits until a page has shown its token. Returns false after `patience`.
  bool wait_for_page(std::chrono::milliseconds patience);

  /// Returns the number of pages that have shown their token. From any thread.
  [[nodiscard]] std::size_t pages() const;

 private:
  class Sessions;
  std::unique_ptr<Sessions> sessions_;
};

/// Returns true if this build contains the page.
bool view_page_is_built() noexcept;

}  // namespace haptrace
