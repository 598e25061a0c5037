// The live view of a session, as options of a verb.
#pragma once

#include "cli/live_training.h"
#include "cli/verb.h"
#include "player/tuning/commands.h"
#include "view/live_view.h"

#include <memory>
#include <optional>
#include <string>

namespace haptrace::cli {

/// Throws Error(input) if this build has no page.
void require_page();

/// Opens an address in the user's browser, if there is a display. Returns false if nothing could be started.
bool open_in_browser(const std::string& address);

struct ViewArguments {
  std::string port;        ///< of --view; empty: any free one
  std::string token_file;  ///< keeps the therapist's token; empty: a new token for every session
  std::string on_page_lost = "soften";
  bool control = false, no_browser = false;
  const CLI::Option* option = nullptr;

  void add_to(CLI::App& app);
  [[nodiscard]] bool asked() const { return option != nullptr && option->count() > 0; }
};

/// Shows the sessions of a verb on the page. Does nothing unless --view was given.
///
/// Threads: one.
class LivePage final : public SessionObserver {
 public:
  /// Starts the server, prints its addresses, and opens the browser. Throws Error(input): the port is taken, this
  /// haptrace has no page, or an option needs --view. `verb` names the session; a page raises `stop`, which is
  /// borrowed.
  LivePage(const ViewArguments& arguments, const SessionArguments& session, const Output& output, std::string verb,
           StopRequest& stop);

  /// Lets the page watch and end the session. A simulated device runs on the real clock, because people watch it.
  void watch(SessionOptions& session);

  /// Tells the page whether a session follows the one that begins next: only the last one ends what it shows. As long
  /// as nobody says so, none follows.
  void expect_more(bool more) noexcept { more_ = more; }

  /// Lets a page give commands as long as it lives. Destroy it before the commands.
  class [[nodiscard]] Use {
   public:
    Use(LivePage& page, Commands& commands) : page_(page) { page_.use(commands); }
    ~Use() { page_.release(); }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    LivePage& page_;
  };

  /// Shows the therapist the state of a programme (programme_message).
  void programme(const nlohmann::json& state);

  /// Changes what the trainee sees; its states follow the samples. Without a change, there is no training screen.
  void training(const std::function<void(TrainingProgress&)>& how);

  [[nodiscard]] SampleSink& sink() noexcept override { return sinks_; }
  void begins(Device& device, const SessionOptions& options, const RecordingColumns& columns,
              bool virtual_time) override;
  void shows(const SessionView& view) override { view_->show(view); }
  void ends(const SessionResult& result) override { view_->end(result, more_); }

 private:
  /// Passes everything on to the view, and samples to the training screen too.
  struct Sinks final : SampleSink {
    SampleSink* view = nullptr;
    LiveTraining* training = nullptr;

    void start(std::int64_t monotonic_ns) noexcept override { view->start(monotonic_ns); }
    void push(const Sample& sample) noexcept override {
      view->push(sample);
      if (training != nullptr) training->push(sample);
    }
    void push(const Event& event) noexcept override { view->push(event); }
    void push_contact(const ContactSample& contact) noexcept override { view->push_contact(contact); }
    void between_ticks(bool may_wait) noexcept override { view->between_ticks(may_wait); }
  };

  void use(Commands& commands);

  /// Ends what is shown: also a session that threw, and a programme after its last repetition.
  void release();

  const Output& output_;
  std::string verb_;
  StopRequest& stop_;
  std::shared_ptr<const Scene> scene_;  ///< that the page shows
  std::optional<LiveView> view_;
  std::optional<LiveTraining> training_;
  Sinks sinks_;
  Commands* commands_ = nullptr;
  bool more_ = false;
};

}  // namespace haptrace::cli
