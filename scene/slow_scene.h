// A scene that is slower than the servo loop, and the prediction of its forces in between.
#pragma once

#include "base/mailbox.h"
#include "scene/scene.h"
#include "scene/scene_session.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace haptrace {

/// Returns notes for the user on the parts of the scene's surfaces that a prediction leaves out.
std::vector<std::string> notes_on_prediction(const Scene& scene, Prediction prediction);

/// Queries a scene at every n-th tick, in its own thread, and predicts its force at every tick from the answers
/// received.
///
/// A query contains the tool's position at that tick. The answer is used as soon as it arrives; on a virtual clock
/// exactly n ticks later, so that it is n to 2n - 1 ticks old during its use. An answer older than kStale periods is no
/// longer used: there is no contact until the next one.
///
/// Threads: the servo loop's thread and an own thread, in which the scene is queried and reset. On a virtual clock the
/// loop's thread does that between ticks. Real-time: reset and answer.
class SlowScene final : public Touchable {
 public:
  static constexpr int kStale = 10;  ///< [periods]

  /// Prepares `scene` for its rate. Throws Error(input) when the rate is not from 0.1 Hz to the servo rate.
  SlowScene(std::shared_ptr<Scene> scene, const SlowSceneOptions& options, double servo_rate_hz, double resolution = 0);
  ~SlowScene() override;
  SlowScene(const SlowScene&) = delete;
  SlowScene& operator=(const SlowScene&) = delete;

  void reset() noexcept override;
  [[nodiscard]] SceneAnswer answer(const Touch& touch) noexcept override;
  void between_ticks(bool may_wait) noexcept override;
  [[nodiscard]] std::vector<std::string> remarks() const override;

  /// Returns n, the number of ticks from one query to the next. Throws like the constructor.
  static int ticks_between(double rate_hz, double servo_rate_hz);

 private:
  /// State of the tool at a query. Times count ticks from the last reset.
  struct Question {
    std::uint32_t number = 0;   ///< counts from 1
    std::uint32_t session = 0;  ///< number of resets before it
    std::int64_t time = 0;
    Touch touch;
  };
  struct Answer {
    Question question;
    ContactList contacts;
  };

  void serve() noexcept;  ///< runs in its own thread until the end
  void serve(Question question) noexcept;
  void take() noexcept;
  void ask(const Touch& touch) noexcept;
  [[nodiscard]] Contact predicted(const Contact& last, const Touch& touch) const noexcept;
  [[nodiscard]] Contact extrapolated(Contact contact) const noexcept;
  [[nodiscard]] Contact modelled(Contact contact, const Touch& touch) const noexcept;

  std::shared_ptr<Scene> scene_;
  Prediction prediction_;
  double servo_rate_hz_;
  int period_;  ///< [ticks]

  // Used only by the servo loop.
  std::int64_t time_ = 0, next_ = 0;
  std::uint32_t session_ = 0;
  bool first_ = true;       ///< the next tick is the first
  bool virtual_ = true;     ///< virtual clock; assumed until the loop says otherwise
  Answer newest_, before_;  ///< number 0: none
  Question question_;       ///< the newest query
  bool unsent_ = false;     ///< the newest query is not yet sent
  ContactList predicted_;
  std::uint64_t late_ = 0, stale_ = 0;  ///< late answers, ticks with a stale answer

  Answer served_;  ///< last answer; used only by the thread that answers
  Mailbox<Question> questions_;
  Mailbox<Answer> answers_;
  std::atomic<std::uint32_t> asked_{0}, answered_{0};  ///< numbers of queries
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace haptrace
