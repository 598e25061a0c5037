#include "view/recording_view.h"

#include "base/error.h"
#include "base/severity.h"
#include "player/session.h"
#include "player/tuning/tuning_server.h"
#include "view/scene_messages.h"
#include "view/view_server.h"
#include "view/viewed_recording.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

constexpr std::size_t kMostOpen = 4;            // recordings
constexpr std::size_t kMostDescribed = 200;     // recordings whose title and duration the list has
constexpr std::chrono::milliseconds kScan{50};  // time for phases between two requests
constexpr int kMostJobs = 32;                   // of a page, that wait

/// Entry of the list of recordings.
struct Listed {
  std::string file, name, title;
  double duration = kNaN;  ///< [s]
};

/// Runs jobs one after the other in a thread, and other work while there are none.
class Worker {
 public:
  /// `idle` does a piece of work and returns false if there is none until the next job.
  explicit Worker(std::function<bool()> idle)
      : idle_(std::move(idle)), thread_([this](const std::stop_token& stop) { run(stop); }) {}

  /// Adds a job. After stop() it is never done.
  void add(std::function<void()> job) {
    const std::lock_guard lock(mutex_);
    jobs_.push_back(std::move(job));
    changed_.notify_one();
  }

  /// Ends the thread after its present job.
  void stop() {
    thread_.request_stop();
    thread_.join();
  }

 private:
  void run(const std::stop_token& stop) {
    bool more = true;
    while (!stop.stop_requested()) {
      std::function<void()> job;
      {
        std::unique_lock lock(mutex_);
        if (!more) changed_.wait(lock, stop, [this] { return !jobs_.empty(); });
        if (!jobs_.empty()) {
          job = std::move(jobs_.front());
          jobs_.pop_front();
        }
      }
      if (job) {
        job();
        more = true;
      } else if (!stop.stop_requested()) {
        more = idle_();
      }
    }
  }

  std::function<bool()> idle_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<std::function<void()>> jobs_;
  std::jthread thread_;
};

}  // namespace

/// The recordings of a view. Pages belong to the server's thread, recordings to the worker's.
class RecordingView::Shelf final : private PageHandler {
 public:
  Shelf(std::vector<std::string> files, const Options& options) {
    if (files.empty()) throw input_error("there is no recording to view");
    for (std::string& file : files) {
      std::string name = std::filesystem::path(file).filename().string();
      list_.push_back({std::move(file), std::move(name), "", kNaN});
    }
    (void)opened(0);
    describe();
    worker_ = std::make_unique<Worker>([this] { return work(); });
    PageHandler& handler = *this;
    server_ = std::make_unique<ViewServer>(
        ViewServer::Options{.port = options.port, .tokens = {{ViewRole::viewer, new_tuning_token()}}}, handler);
    server_->start();
  }
  ~Shelf() override { worker_->stop(); }
  Shelf(const Shelf&) = delete;
  Shelf& operator=(const Shelf&) = delete;

  bool wait_for_page(std::chrono::milliseconds patience) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, patience, [this] { return page_count_.load() > 0; });
  }
  [[nodiscard]] std::size_t page_count() const noexcept { return page_count_.load(); }
  [[nodiscard]] std::string address() const { return server_->address(ViewRole::viewer); }

 private:
  /// A page that a job may outlive.
  using Page = std::weak_ptr<ViewPage>;

  /// A page's wish to see a recording, until it wishes to see another.
  struct Opening {
    std::shared_ptr<std::atomic<std::uint64_t>> openings;
    std::uint64_t number;
    [[nodiscard]] bool is_current() const noexcept { return *openings == number; }
  };

  struct Reader {
    std::shared_ptr<std::atomic<std::uint64_t>> openings = std::make_shared<std::atomic<std::uint64_t>>(0);
    std::size_t index = 0;  ///< recording that the page shows
    std::shared_ptr<std::atomic<int>> waiting = std::make_shared<std::atomic<int>>(0);  ///< jobs for the page
  };

  struct Open {
    std::size_t index;
    std::unique_ptr<ViewedRecording> source;
  };

  /// Returns a recording, open. Throws Error(input).
  ViewedRecording& opened(std::size_t index) {
    const auto found = std::find_if(open_.begin(), open_.end(), [&](const Open& open) { return open.index == index; });
    if (found != open_.end()) {
      std::rotate(open_.begin(), found, found + 1);
      return *open_.front().source;
    }
    open_.push_front({index, std::make_unique<ViewedRecording>(list_[index].file)});
    if (open_.size() > kMostOpen) open_.pop_back();
    return *open_.front().source;
  }

  /// Fills the list in. Files that cannot be read stay in it: the page reports why when it opens one.
  void describe() {
    for (std::size_t i = 0; i < std::min(list_.size(), kMostDescribed); ++i) {
      try {
        const ViewedRecording& source = opened(i);
        list_[i].title = source.header().title;
        list_[i].duration = source.duration();
      } catch (const Error&) {
      }
    }
    (void)opened(0);
  }

  void joined(ViewPage& page, const PageMessage&) override {
    count_pages();
    nlohmann::json recordings = nlohmann::json::array();
    for (const Listed& listed : list_) {
      nlohmann::json entry{{"name", listed.name}, {"title", listed.title}};
      if (listed.duration >= 0) entry["duration"] = listed.duration;
      recordings.push_back(std::move(entry));
    }
    page.send({{"type", "hello"},
               {"version", 1},
               {"role", to_string(page.role())},
               {"software", software_name()},
               {"live", false},
               {"control", false},
               {"steer", false},
               {"on_page_lost", "ignore"},
               {"recordings", std::move(recordings)}});
    show(page, 0, 0);
  }

  void left(ViewPage& page) override {
    pages_.erase(&page);
    count_pages();
  }

  void received(ViewPage& page, const PageMessage& message) override {
    using Type = PageMessage::Type;
    if (message.type == Type::ping)
      page.send({{"type", "pong"}, {"id", message.id}, {"sent", message.sent}, {"time", 0}});
    if (message.type == Type::open) show(page, message.index, message.id);
    if (message.type == Type::bins || message.type == Type::rows) request(page, message);
  }

  void steered(ViewPage&, const PageIntention&) override {}

  void show(ViewPage& page, std::size_t index, std::uint32_t id) {
    if (index >= list_.size()) return refuse(page, id, "there is no recording of this number");
    Reader& reader = pages_[&page];
    reader.index = index;
    const Opening opening{reader.openings, ++*reader.openings};
    give(page, id, [this, index, opening, to = handle_of(page)] {
      ViewedRecording& source = opened(index);
      const auto send = [&](const nlohmann::json& message) { post_text(to, text_of(message)); };
      send(source.recording(index, list_[index].name));
      if (const RecordedScene& scene = source.header().scene; !scene.empty()) {
        const std::vector<ShownObject> objects = shown_objects(scene, list_[index].file);
        send(scene_message(objects, ++scenes_));
        for (Frame& mesh : mesh_frames(objects, scenes_)) post_frame(to, std::move(mesh));
      }
      send(source.events());
      Frame path = source.path();
      path.request = ++paths_;
      post_frame(to, std::move(path));
      const auto warn = [&](Severity severity, const char* code, const std::string& text) {
        send({{"type", "warning"},
              {"severity", to_string(severity)},
              {"code", code},
              {"time", nullptr},
              {"text", text}});
      };
      if (!source.damage().empty()) warn(Severity::problem, "damage", source.damage());
      if (source.unfinished())
        warn(Severity::warning, "unfinished",
             "the recording is not finished: this page shows what it held when it was opened. If its session still "
             "runs, open it again later, or give --view to the session; if it was killed, use haptrace recover");
      show_phases(index, to, opening, 0);
    });
  }

  /// Sends the phases from the stretch of a number on, and continues after other jobs until all are known or the page
  /// has opened another recording. A job of the worker.
  void show_phases(std::size_t index, const Page& to, const Opening& opening, std::size_t first) {
    ViewedRecording& source = opened(index);
    const bool done = source.scan_phases(kScan);
    const std::size_t next = source.phases().size();
    if (first == 0 || next > first || done) post_text(to, text_of(source.phases().message(first, first == 0, done)));
    if (done) return;
    worker_->add([this, index, to, opening, next] {
      if (to.expired() || !opening.is_current()) return;
      try {
        show_phases(index, to, opening, next);
      } catch (const std::exception& error) {
        post_text(to, text_of(error_of(0, error.what())));
      }
    });
  }

  void request(ViewPage& page, const PageMessage& message) {
    if (page.is_busy()) return refuse(page, message.id, "earlier answers are not fetched yet");
    give(page, message.id, [this, message, index = pages_[&page].index, to = handle_of(page)] {
      ViewedRecording& source = opened(index);
      auto parsed = request_of(message, source.channels());
      if (std::holds_alternative<std::string>(parsed))
        return post_text(to, text_of(error_of(message.id, std::get<std::string>(parsed))));
      source.ask(std::get<ViewRequest>(parsed), [this, to](Frame frame) { post_frame(to, std::move(frame)); });
    });
  }

  /// Lets the worker do a job for a page, and reports its errors to the page.
  void give(ViewPage& page, std::uint32_t id, std::function<void()> job) {
    const auto& waiting = pages_[&page].waiting;
    if (*waiting >= kMostJobs) return refuse(page, id, "too many requests wait");
    ++*waiting;
    worker_->add([this, id, waiting, to = handle_of(page), job = std::move(job)] {
      --*waiting;
      if (to.expired()) return;
      try {
        job();
      } catch (const std::exception& error) {
        post_text(to, text_of(error_of(id, error.what())));
      }
    });
  }

  static nlohmann::json error_of(std::uint32_t id, const std::string& text) {
    return {{"type", "error"}, {"id", id}, {"text", text}};
  }
  static void refuse(ViewPage& page, std::uint32_t id, const char* text) { page.send(error_of(id, text)); }

  [[nodiscard]] Page handle_of(const ViewPage& page) const {
    for (const auto& known : server_->pages())
      if (known.get() == &page) return known;
    return {};
  }

  void post_text(const Page& to, SharedText text) {
    server_->post([to, text = std::move(text)] {
      if (const auto page = to.lock()) page->send(text);
    });
  }
  void post_frame(const Page& to, Frame frame) {
    server_->post([to, frame = std::move(frame)]() mutable {
      if (const auto page = to.lock()) page->answer(std::move(frame));
    });
  }

  /// Builds ahead, for the recording that was used last.
  bool work() {
    for (const Open& open : open_)
      if (open.source->work()) return true;
    return false;
  }

  void count_pages() {
    const std::lock_guard lock(mutex_);
    page_count_ = server_->pages().size();
    changed_.notify_all();
  }

  std::vector<Listed> list_;                 ///< constant once the server runs
  std::uint32_t paths_ = 0, scenes_ = 0;     ///< the worker's; paths and scenes that were sent
  std::deque<Open> open_;                    ///< the worker's; the one that was used last first
  std::map<const ViewPage*, Reader> pages_;  ///< the server's
  std::mutex mutex_;
  std::condition_variable changed_;
  std::atomic<std::size_t> page_count_{0};
  std::unique_ptr<Worker> worker_;      ///< stops before the server that its jobs use
  std::unique_ptr<ViewServer> server_;  ///< last: its thread uses the members above
};

RecordingView::RecordingView(std::vector<std::string> files, const Options& options)
    : shelf_(std::make_unique<Shelf>(std::move(files), options)) {}

RecordingView::~RecordingView() = default;

std::string RecordingView::address() const {
  return shelf_->address();
}

bool RecordingView::wait_for_page(std::chrono::milliseconds patience) {
  return shelf_->wait_for_page(patience);
}

std::size_t RecordingView::pages() const {
  return shelf_->page_count();
}

}  // namespace haptrace
