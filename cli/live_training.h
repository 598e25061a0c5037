// The screen of a trainee on the page of a live view.
#pragma once

#include "base/mailbox.h"
#include "player/programme/training_screen.h"
#include "player/tuning/commands.h"
#include "view/live_view.h"

#include <functional>
#include <mutex>
#include <thread>

namespace haptrace::cli {

/// Follows a session by its samples, and sends every change of the trainee's screen to the page.
///
/// Threads: push from the servo loop, ask and change from one other thread. Real-time: push.
class LiveTraining final : public SampleSink {
 public:
  /// Borrows `view`, which shows nothing before the first change.
  explicit LiveTraining(LiveView& view);

  using SampleSink::push;
  void push(const Sample& sample) noexcept override { newest_.post(sample); }

  /// Asks `commands`, borrowed until the next call, whether a repetition that ends was skipped; null: none was.
  void ask(const Commands* commands);

  /// Changes the screen and sends it.
  void change(const std::function<void(TrainingProgress&)>& how);

 private:
  void follow(const std::stop_token& stop);
  void send();

  LiveView& view_;
  Mailbox<Sample> newest_;
  std::mutex mutex_;  ///< protects the next two
  TrainingProgress progress_;
  const Commands* commands_ = nullptr;
  std::jthread thread_;
};

}  // namespace haptrace::cli
