#include "view/live_view.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "base/json_reader.h"
#include "base/stopwatch.h"
#include "control/event_words.h"
#include "devices/loop/clock.h"
#include "devices/sim/hand_steering.h"
#include "player/tuning/commands.h"
#include "player/tuning/tuning_server.h"
#include "recorder/annotations.h"
#include "view/live_sink.h"
#include "view/live_source.h"
#include "view/scene_messages.h"
#include "view/view_server.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <fmt/format.h>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

namespace haptrace {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto kBatch = 16ms;                                  // period of the samples
constexpr int kStatusesPerSecond = 4, kBatchesPerStatus = 16;  // 4 Hz
constexpr std::size_t kLargestBatch = 2048;                    // rows of a frame
constexpr double kBackfill = 12;                               // [s]
constexpr std::size_t kMostEvents = 2000;                      // kept for pages that join later
constexpr std::size_t kMostWarnings = 500;
constexpr double kStale = 0.3;        // time without rows after which the status has no values [s]
constexpr double kMargin = 0.1;       // by which an intention may leave the workspace, as a share of its size
constexpr double kHoldSilence = 0.3;  // silence after which a page lets go of the hand [s]

constexpr EnumNames<PageLost, 3> kPageLost{"reaction", {"soften", "stop", "ignore"}};
constexpr EnumNames<LiveControl::Kind, 3> kControlKinds{"kind", {"number", "switch", "factor"}};

void put_known(nlohmann::json& object, const char* key, double value) {
  if (std::isfinite(value)) object[key] = value;
}

nlohmann::json message_of(const Warning& warning) {
  return {{"type", "warning"},
          {"severity", to_string(warning.severity)},
          {"code", warning.code},
          {"time", json_of_number(warning.time)},
          {"text", warning.text}};
}

nlohmann::json json_of(const LiveControl& control) {
  return {{"name", control.name},
          {"label", control.label},
          {"unit", control.unit},
          {"value", json_of_number(control.value)},
          {"least", json_of_number(control.least)},
          {"largest", json_of_number(control.largest)},
          {"because", control.because},
          {"kind", kControlKinds.name(control.kind)},
          {"step", json_of_number(control.step)},
          {"ratio", json_of_number(control.ratio)},
          {"text", control.text}};
}

/// Returns the part of an intention that the workspace allows.
Vec3 within(const DeviceInfo& device, const Vec3& position) {
  const Vec3 margin = kMargin * (device.workspace_max - device.workspace_min);
  return position.cwiseMax(device.workspace_min - margin).cwiseMin(device.workspace_max + margin);
}

/// Returns the token to use: `asked`, or a new one. It is a part of an address, so it has no other characters than
/// these. The page has the same rule (readToken in client.ts).
std::string token_from(const std::string& asked) {
  if (asked.empty()) return new_tuning_token();
  constexpr std::size_t kShortest = 16, kLongest = 128;
  constexpr std::string_view kAllowed = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";
  if (asked.size() < kShortest || asked.size() > kLongest || asked.find_first_not_of(kAllowed) != std::string::npos)
    throw input_error(
        fmt::format("a token of the view must have {} to {} letters and digits, and nothing else; remove its file to "
                    "get a new one",
                    kShortest, kLongest));
  return asked;
}

}  // namespace

PageLost parse_page_lost(std::string_view name) {
  return kPageLost.parse(name);
}

const char* to_string(PageLost reaction) noexcept {
  return kPageLost.name(reaction);
}

/// State of the view. Everything but the sink and what is marked otherwise belongs to the server's thread.
class LiveView::Sessions final : private PageHandler {
 public:
  explicit Sessions(const Options& options)
      : options_(options),
        server_({.port = options.port,
                 .tokens = {{ViewRole::therapist, token_from(options.token)},
                            {ViewRole::trainee, token_from(options.trainee_token)}}},
                *this) {
    server_.every(kBatch, [this] { beat(); });
    server_.start();
  }
  ~Sessions() override { sink.let_wait(false); }
  Sessions(const Sessions&) = delete;
  Sessions& operator=(const Sessions&) = delete;

  void begin(const ViewedSession& session, const ViewTargets& targets) {
    server_.run([&] {
      release("", false);
      session_ = session;
      targets_ = targets;
      sink.prepare(session.rate_hz);
      source_.emplace(*session_);
      path_ = frame_of(session_->path);
      path_.request = static_cast<std::uint32_t>(trial_ + 1);
      annotations_seen_ = targets.annotations != nullptr ? targets.annotations->count() : 0;
      events_ = nlohmann::json::array();
      warnings_shown_ = nlohmann::json::array();
      view_ = {};
      share_ = 1;
      running_ = true;
      // The commands of a programme outlive its repetitions, and so does what a lost page has softened.
      softened_ = softened_ && more_;
      lost_stop_ = false;
      more_ = false;
      reason_.clear();
      zero_force_.clear();
      input_ = {};
      controls_text_.reset();
      ++trial_;
      const auto pages = server_.pages();
      for (const auto& page : pages) introduce(*page);
    });
    sink.let_wait(true);
  }

  void end(const std::string& reason, const char* zero_force, double share, bool more) {
    server_.run([&] {
      if (!running_) return;
      beat();
      zero_force_ = zero_force;
      if (share >= 0) share_ = share;
      release(reason, more);
    });
  }

  void over(const std::string& reason) {
    server_.run([&] {
      targets_ = {};
      if (!std::exchange(more_, false) || !source_) return;
      if (!reason.empty()) reason_ = reason;
      controls_text_.reset();
      broadcast(status());
    });
  }

  void scene(const std::vector<ShownObject>& objects) {
    server_.run([&] {
      scene_ = {};
      if (objects.empty()) return;
      scene_.message = text_of(scene_message(objects, ++scenes_));
      scene_.meshes = mesh_frames(objects, scenes_);
    });
  }

  void show(const SessionView& view) {
    server_.post([this, view] {
      view_ = view;
      for (const Warning& warning : view.warnings) {
        nlohmann::json message = message_of(warning);
        broadcast(message);
        if (warnings_shown_.size() < kMostWarnings) warnings_shown_.push_back(std::move(message));
      }
    });
  }

  void keep(const char* type, const nlohmann::json& state) {
    nlohmann::json message = state.is_object() ? state : nlohmann::json::object();
    message["type"] = type;
    server_.post([this, type, text = text_of(message)] {
      kept_[type] = text;
      broadcast(text);
    });
  }

  std::vector<Warning> take_warnings() {
    const std::lock_guard lock(mutex_);
    return std::exchange(warnings_, {});
  }

  bool wait_for_page(std::chrono::milliseconds patience) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, patience, [this] { return page_count_.load() > 0; });
  }

  [[nodiscard]] std::size_t page_count() const noexcept { return page_count_.load(); }
  [[nodiscard]] std::string address(ViewRole role) const { return server_.address(role); }

  LiveSink sink;

 private:
  [[nodiscard]] bool controls(const ViewPage& page) const {
    return options_.control && page.role() == ViewRole::therapist;
  }

  void joined(ViewPage& page, const PageMessage& hello) override {
    count_pages();
    if (controls(page)) heard();
    page.send({{"type", "hello"},
               {"version", 1},
               {"role", to_string(page.role())},
               {"software", software_name()},
               {"live", true},
               {"control", controls(page)},
               {"steer", options_.steer},
               {"on_page_lost", to_string(options_.on_page_lost)},
               {"recordings", nlohmann::json::array({{{"name", session_ ? session_->name : ""},
                                                      {"title", session_ ? session_->title : ""},
                                                      {"duration", source_ ? source_->time() : 0}}})}});
    introduce(page);
    for (const auto& [type, text] : kept_) page.send(text);
    if (hello.last && source_) backfill(page, *hello.last);
    if (source_) page.send(status());
  }

  /// Sends what a page needs to show the session.
  void introduce(ViewPage& page) {
    if (!source_) return;
    page.send(recording());
    if (scene_.message) page.send(scene_.message);
    page.meshes_sent = 0;
    page.send(events_message(events_, true));
    page.send(source_->phases.all(!running_));
    for (const nlohmann::json& warning : warnings_shown_) page.send(warning);
    page.answer(path_);
    if (controls_text_ && controls(page)) page.send(controls_text_);
  }

  [[nodiscard]] nlohmann::json recording() const {
    nlohmann::json limits = nlohmann::json::object();
    put_known(limits, "max_force", session_->max_force);
    put_known(limits, "max_deviation", session_->max_deviation);
    put_known(limits, "max_speed", session_->max_speed);
    const DeviceInfo& device = session_->device;
    return {{"type", "recording"},
            {"index", 0},
            {"trial", trial_},
            {"name", session_->name},
            {"title", session_->title},
            {"subject", session_->subject},
            {"session", session_->uuid},
            {"verb", session_->verb},
            {"mode", session_->mode},
            {"rate_hz", session_->rate_hz},
            {"start", 0},
            {"end", source_->time()},
            {"device",
             {{"name", device.name},
              {"model", device.model},
              {"workspace", {{"min", json_of(device.workspace_min)}, {"max", json_of(device.workspace_max)}}},
              {"max_force", device.max_force},
              {"position_resolution", device.position_resolution}}},
            {"columns", json_of(source_->channels())},
            {"limits", limits},
            {"input", session_->input},
            {"virtual_time", session_->virtual_time}};
  }

  void backfill(ViewPage& page, double last) {
    const ViewRows rows = source_->rows_after(last, kBackfill);
    for (std::size_t first = 0; first < rows.size(); first += kLargestBatch) {
      ViewRows part(rows.planes.size());
      part.add(rows, first, std::min(kLargestBatch, rows.size() - first));
      Frame frame = frame_of(part);
      frame.flags = FrameFlags::kBackfill;
      if (first == 0 && rows.time_ns.front() > nanoseconds(last + 2 / session_->rate_hz))
        frame.flags |= FrameFlags::kGap;
      frame.sent = source_->time();
      page.answer(std::move(frame));
    }
  }

  void left(ViewPage& page) override {
    count_pages();
    if (holder_ == &page) let_go();
  }

  void received(ViewPage& page, const PageMessage& message) override {
    using Type = PageMessage::Type;
    if (message.type == Type::stop) {
      // Twice: the loop then sends zero force at this tick, whatever the time of the release.
      StopRequest* const stop = running_ && targets_.stop != nullptr ? targets_.stop : options_.stop_between;
      if (stop != nullptr) stop->raise(StopSource::page), stop->raise(StopSource::page);
      return;
    }
    if (controls(page)) heard();
    switch (message.type) {
      case Type::want:
        page.wants = message.wants;
        break;
      case Type::bins:
      case Type::rows:
        request(page, message);
        break;
      case Type::command:
        command(page, message);
        break;
      case Type::shown:
        shown(message);
        break;
      case Type::ping:
        page.send(
            {{"type", "pong"}, {"id", message.id}, {"sent", message.sent}, {"time", source_ ? source_->time() : 0}});
        break;
      default:
        break;
    }
  }

  void request(ViewPage& page, const PageMessage& message) {
    std::string refusal = "no session is shown yet";
    if (source_) {
      auto parsed = request_of(message, source_->channels());
      if (std::holds_alternative<ViewRequest>(parsed)) {
        if (!page.is_busy()) {
          source_->ask(std::get<ViewRequest>(parsed), [&page](Frame frame) { page.answer(std::move(frame)); });
          return;
        }
        refusal = "earlier answers are not fetched yet";
      } else {
        refusal = std::get<std::string>(parsed);
      }
    }
    page.send({{"type", "error"}, {"id", message.id}, {"text", refusal}});
  }

  void command(ViewPage& page, const PageMessage& message) {
    std::string answer = "error no session takes commands now";
    if (page.role() != ViewRole::therapist)
      answer = "error the trainee's page sends no commands; the therapist's page does";
    else if (!options_.control)
      answer = "error this page may not send commands; the session needs --control";
    else if (targets_.commands != nullptr)
      answer = targets_.commands->obey(message.line);
    page.send({{"type", "answer"}, {"id", message.id}, {"text", answer}});
    if (controls(page)) show_controls();
  }

  void shown(const PageMessage& message) {
    if (targets_.annotations == nullptr || !source_ || !running_) return;
    const bool go = message.what == "go";
    if (!go && message.what != "done") return;
    const double time = std::clamp(message.time, 0.0, source_->time());
    targets_.annotations->add(
        {nanoseconds(time), go ? EventCode::shown_go : EventCode::shown_done,
         fmt::format("{} shown: trial {}, frame {}", go ? "go" : "done", message.trial, message.frame)});
  }

  void steered(ViewPage& page, const PageIntention& intention) override {
    if (controls(page)) heard();
    if (!options_.steer || targets_.steering == nullptr || !running_) return;
    if (holder_ != nullptr && holder_ != &page) return;
    if (holder_ == nullptr && intention.grip <= 0) return;
    holder_ = intention.grip > 0 ? &page : nullptr;
    held_ = Clock::now();
    note_input(intention);
    targets_.steering->post({within(session_->device, intention.position), intention.grip, monotonic_ns()});
    hand_ = intention.position;
  }

  /// Notes what moves the hand, whenever that changes. Unknown numbers are not noted.
  void note_input(const PageIntention& intention) {
    constexpr std::uint32_t kMostInputs = 5, kMostDepths = 1;
    const std::pair now(intention.input, intention.depth);
    if (targets_.annotations == nullptr || now == input_ || now.first < 1 || now.first > kMostInputs ||
        now.second > kMostDepths)
      return;
    input_ = now;
    targets_.annotations->input(static_cast<int>(now.first), now.second == 1);
  }

  void let_go() {
    holder_ = nullptr;
    if (targets_.steering != nullptr && session_)
      targets_.steering->post({within(session_->device, hand_), 0, monotonic_ns()});
  }

  /// Notes a sign of life of a page with control.
  void heard() {
    control_seen_ = true;
    silence_ = 0;
    if (!std::exchange(softened_, false) || targets_.commands == nullptr) return;
    (void)targets_.commands->attend(true);
    warn({Severity::note, "page_back", source_->time(), "the controlling page is back"});
  }

  /// Reacts to the silence of all pages with control. Time in which this thread did not run does not count.
  void watch_control(Clock::time_point now) {
    constexpr double kLongestStep = 0.1;  // [s]
    silence_ = std::min(silence_ + std::min(seconds_between(beat_, now), kLongestStep), 2 * options_.page_patience);
    if (!running_ || !control_seen_ || silence_ < options_.page_patience || softened_ || lost_stop_) return;
    switch (options_.on_page_lost) {
      case PageLost::soften: {
        softened_ = true;
        const bool softens = targets_.commands != nullptr && targets_.commands->attend(false);
        warn({Severity::warning, "page_lost", source_->time(),
              softens ? "the controlling page is silent: the feedback is softened until it is back"
                      : "the controlling page is silent"});
        break;
      }
      case PageLost::stop:
        lost_stop_ = true;
        warn({Severity::problem, "page_lost", source_->time(), "the controlling page is silent: the session stops"});
        if (targets_.stop != nullptr) targets_.stop->raise(StopSource::lost_page);
        break;
      case PageLost::ignore:
        break;
    }
  }

  void warn(Warning warning) {
    const std::lock_guard lock(mutex_);
    if (warnings_.size() < kMostWarnings) warnings_.push_back(std::move(warning));
  }

  /// Takes the samples of the session and sends them. Called every kBatch.
  void beat() {
    const Clock::time_point now = Clock::now();
    if (running_) {
      take_samples(now);
      if (holder_ != nullptr && seconds_between(held_, now) > kHoldSilence) let_go();
    }
    watch_control(now);
    send_meshes();
    if (++beats_ % kBatchesPerStatus == 0 && source_) {
      show_status();
      show_controls();
    }
    beat_ = now;
  }

  /// Sends every page the next mesh of the scene, when it has taken the one before.
  void send_meshes() {
    if (!scene_.message || !source_) return;
    const auto pages = server_.pages();
    for (const auto& page : pages)
      if (page->meshes_sent < scene_.meshes.size() && !page->is_busy())
        page->answer(scene_.meshes[page->meshes_sent++]);
  }

  void take_samples(Clock::time_point now) {
    nlohmann::json events = nlohmann::json::array();
    sink.take([this](const Sample& sample, const ContactSample* contact) { source_->add(sample, contact); },
              [&](const Event& event) {
                events.push_back(event_json(event));
                if (const EventWords* words = words_of(event.code); words != nullptr && words->share >= 0) {
                  const double share = event.values[static_cast<std::size_t>(words->share)];
                  if (std::isfinite(share)) share_ = share;
                }
              });
    if (targets_.annotations != nullptr) {
      const std::uint64_t count = targets_.annotations->count();
      const std::vector<TimedEvent> said = targets_.annotations->from(annotations_seen_);
      for (const TimedEvent& event : said)
        events.push_back(event_json(seconds(event.time_ns), static_cast<std::int32_t>(event.code), event.text));
      annotations_seen_ = std::max(annotations_seen_ + said.size(), count);
    }
    if (!events.empty()) tell(std::move(events));
    nlohmann::json phases = source_->phases.take(false);
    if (!phases["list"].empty()) broadcast(phases);
    const ViewRows rows = source_->take();
    if (rows.size() == 0) return;
    fresh_ = now;
    stream(rows);
  }

  void stream(const ViewRows& rows) {
    const auto pages = server_.pages();
    const auto wanted = [&](PageWants what) {
      return std::any_of(pages.begin(), pages.end(), [&](const auto& page) { return page->wants == what; });
    };
    if (wanted(PageWants::state)) stream(frame_of(rows, FrameKind::state), PageWants::state);
    for (std::size_t first = 0; wanted(PageWants::samples) && first < rows.size(); first += kLargestBatch) {
      ViewRows part(rows.planes.size());
      part.add(rows, first, std::min(kLargestBatch, rows.size() - first));
      Frame frame = frame_of(part);
      if (first == 0 && sink.lost() > lost_told_) frame.flags |= FrameFlags::kGap;
      stream(std::move(frame), PageWants::samples);
    }
    lost_told_ = sink.lost();
  }

  void stream(Frame frame, PageWants to) {
    frame.sent = source_->time();
    const auto shared = std::make_shared<const Frame>(std::move(frame));
    const auto pages = server_.pages();
    for (const auto& page : pages)
      if (page->wants == to) page->stream(shared);
  }

  void tell(nlohmann::json events) {
    for (const nlohmann::json& event : events) events_.push_back(event);
    if (events_.size() > kMostEvents) events_.erase(events_.begin(), events_.end() - kMostEvents);
    broadcast(events_message(std::move(events), false));
  }

  [[nodiscard]] nlohmann::json status() const {
    // Old values are no values: without fresh rows, nothing is known of the device.
    const bool fresh = seconds_between(fresh_, Clock::now()) < kStale;
    const bool known = fresh && running_ && source_->newest();
    const Sample sample = known ? *source_->newest() : Sample{.force = nan3()};
    return {{"type", "status"},
            {"time", source_->time()},
            {"phase", to_string(running_ ? source_->newest().value_or(Sample{}).phase : Phase::idle)},
            {"rate", fresh ? source_->rate() : 0},
            {"asked_rate", session_->rate_hz},
            {"overruns", view_.live.overruns},
            {"force", json_of_number(sample.force.norm())},
            {"deviation", json_of_number((sample.position - sample.reference_position).norm())},
            {"speed", json_of_number(sample.velocity.norm())},
            {"share", std::min(share_, targets_.commands != nullptr ? targets_.commands->share() : 1)},
            {"paused", (view_.recording && view_.recording->paused) ||
                           (targets_.commands != nullptr && targets_.commands->paused())},
            {"recording", recording_state()},
            {"ended", !running_ && !more_},
            {"reason", more_ ? std::string() : reason_},
            {"zero_force", more_ ? std::string() : zero_force_},
            {"pages", server_.pages().size()},
            {"lost_rows", sink.lost()}};
  }

  /// Returns the state of the recording: "" without one, "armed" before its trigger, "paused" or "on".
  [[nodiscard]] const char* recording_state() const {
    if (!running_ || !view_.recording) return "";
    return view_.recording->armed ? "armed" : view_.recording->paused ? "paused" : "on";
  }

  /// Sends the status, more rarely to pages that nobody looks at.
  void show_status() {
    const SharedText text = text_of(status());
    const bool rare = ++statuses_ % kStatusesPerSecond == 0;
    const auto pages = server_.pages();
    for (const auto& page : pages)
      if (rare || page->wants != PageWants::none) page->send(text);
  }

  /// Sends the controls to the pages that may use them, if they changed.
  void show_controls() {
    if (!options_.control || targets_.commands == nullptr) return;
    nlohmann::json list = nlohmann::json::array();
    for (const LiveControl& control : targets_.commands->controls()) list.push_back(json_of(control));
    SharedText text =
        text_of({{"type", "controls"}, {"list", std::move(list)}, {"actions", targets_.commands->actions()}});
    if (controls_text_ && *controls_text_ == *text) return;
    controls_text_ = std::move(text);
    const auto pages = server_.pages();
    for (const auto& page : pages)
      if (controls(*page)) page->send(controls_text_);
  }

  /// Lets go of the targets after the session, but for the commands if there is `more`.
  void release(const std::string& reason, bool more) {
    if (!running_) return;
    let_go();
    running_ = false;
    more_ = more;
    reason_ = reason;
    targets_ = {.commands = more ? targets_.commands : nullptr};
    source_->phases.finish();
    broadcast(source_->phases.take(true));
    broadcast(status());
  }

  void broadcast(const nlohmann::json& message) {
    if (!server_.pages().empty()) broadcast(text_of(message));
  }
  void broadcast(const SharedText& text) {
    const auto pages = server_.pages();  // a page that is closed leaves the list
    for (const auto& page : pages) page->send(text);
  }

  void count_pages() {
    const std::lock_guard lock(mutex_);
    page_count_ = server_.pages().size();
    changed_.notify_all();
  }

  const Options options_;
  std::optional<ViewedSession> session_;
  ViewTargets targets_;
  std::optional<LiveSource> source_;
  Frame path_;
  nlohmann::json events_ = nlohmann::json::array(), warnings_shown_ = nlohmann::json::array();
  SessionView view_;
  double share_ = 1;
  bool running_ = false, more_ = false;
  std::string reason_, zero_force_;
  int trial_ = 0;
  struct {
    SharedText message;  ///< null: the session has no scene
    std::vector<Frame> meshes;
  } scene_;
  std::uint32_t scenes_ = 0;
  SharedText controls_text_;
  std::map<std::string, SharedText> kept_;  ///< programme and training
  std::uint64_t beats_ = 0, statuses_ = 0, lost_told_ = 0, annotations_seen_ = 0;
  Clock::time_point beat_ = Clock::now(), fresh_{};  ///< last beat, last rows

  bool control_seen_ = false, softened_ = false, lost_stop_ = false;
  double silence_ = 0;                ///< of all pages with control [s]
  const ViewPage* holder_ = nullptr;  ///< page that moves the hand
  Clock::time_point held_;
  Vec3 hand_ = Vec3::Zero();
  std::pair<std::uint32_t, std::uint32_t> input_{};  ///< of the hand, as noted in the recording

  mutable std::mutex mutex_;  ///< of the next two
  std::condition_variable changed_;
  std::vector<Warning> warnings_;
  std::atomic<std::size_t> page_count_{0};

  ViewServer server_;  ///< last: its thread uses the members above
};

LiveView::LiveView(const Options& options) {
  check_range("the patience with a silent page", options.page_patience, 0.5, 60, "s");
  sessions_ = std::make_unique<Sessions>(options);
}

LiveView::~LiveView() = default;

std::string LiveView::address(ViewRole role) const {
  return sessions_->address(role);
}

SampleSink& LiveView::sink() noexcept {
  return sessions_->sink;
}

void LiveView::begin(const ViewedSession& session, const ViewTargets& targets) {
  sessions_->begin(session, targets);
}

void LiveView::scene(const std::vector<ShownObject>& objects) {
  sessions_->scene(objects);
}

void LiveView::show(const SessionView& view) {
  sessions_->show(view);
}

void LiveView::end(const SessionResult& result, bool more) {
  const ServoReport& servo = result.servo;
  sessions_->end(servo.detail.empty() ? to_string(servo.cause) : servo.detail, to_string(result.zero_force),
                 result.gain_share, more);
}

void LiveView::over(const std::string& reason) {
  sessions_->over(reason);
}

void LiveView::abandon(const std::string& reason) {
  sessions_->end(reason, "", -1, false);
}

void LiveView::programme(const nlohmann::json& state) {
  sessions_->keep("programme", state);
}

void LiveView::training(const nlohmann::json& state) {
  sessions_->keep("training", state);
}

std::vector<Warning> LiveView::warnings() {
  return sessions_->take_warnings();
}

bool LiveView::wait_for_page(std::chrono::milliseconds patience) {
  return sessions_->wait_for_page(patience);
}

std::size_t LiveView::pages() const {
  return sessions_->page_count();
}

bool view_page_is_built() noexcept {
  return !page_assets().empty();
}

}  // namespace haptrace
