// A scene that is slower than the servo loop, and what its forces are in between.
#pragma once

#include "base/mailbox.h"
#include "scene/scene.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace haptrace {

/// What is sent between two answers of a slow scene (Ellis, Sarkar and Jenkins 1996; Basdogan 2000).
enum class Prediction : std::uint8_t {
  hold,    ///< the last answer
  linear,  ///< the line through the last two, in time, for a period; never pulls, never over 1.5 times the last
  model,   ///< the last contact's plane and stiffness, at the tool's present place (Adachi, Kumano and Ogino 1995)
};

Prediction parse_prediction(std::string_view name);  ///< "hold" | "linear" | "model"; throws Error(input)
const char* to_string(Prediction prediction) noexcept;

struct SlowSceneOptions {
  double rate_hz = 100;  ///< at which the scene is asked; taken to the nearest whole number of ticks
  Prediction prediction = Prediction::hold;
};

/// Asks a scene at every n-th tick, in a thread of its own, and predicts its force at every tick from what has arrived.
///
/// The scene is asked about where the tool was; its answer is used when it is there, on a virtual clock exactly n ticks
/// later, so that an answer is n to 2n - 1 ticks old when it is used. One that is older than kStale periods is no
/// longer used: nothing is touched until there is another.
///
/// Threads: the servo loop's, and its own, in which the scene is answered and reset. Where time stands still between
/// ticks, the loop's does that too. Real-time: reset and answer.
class SlowScene final : public Touchable {
 public:
  static constexpr int kStale = 10;  ///< periods

  /// Prepares `scene` for its rate. Throws Error(input) when that is not from 0.1 Hz to the servo rate.
  SlowScene(std::shared_ptr<Scene> scene, const SlowSceneOptions& options, double servo_rate_hz);
  ~SlowScene() override;
  SlowScene(const SlowScene&) = delete;
  SlowScene& operator=(const SlowScene&) = delete;

  void reset() noexcept override;
  [[nodiscard]] SceneAnswer answer(const Touch& touch) noexcept override;
  void between_ticks(bool may_wait) noexcept override;
  [[nodiscard]] std::vector<std::string> remarks() const override;

  /// n: the ticks from one question to the next. Throws as the constructor.
  static int ticks_between(double rate_hz, double servo_rate_hz);

 private:
  /// Where the tool was. Times count ticks from the last reset.
  struct Question {
    std::uint32_t number = 0;   ///< from 1
    std::uint32_t session = 0;  ///< since which reset
    std::int64_t time = 0;
    Touch touch;
  };
  struct Answer {
    Question question;
    std::vector<Contact> contacts;
  };

  void serve() noexcept;  ///< until the end, in its own thread
  void serve(Question question) noexcept;
  void take() noexcept;
  void ask(const Touch& touch) noexcept;
  [[nodiscard]] Contact predicted(std::size_t object, const Touch& touch) const noexcept;
  [[nodiscard]] Contact extrapolated(std::size_t object) const noexcept;
  [[nodiscard]] Contact modelled(std::size_t object, const Touch& touch) const noexcept;

  std::shared_ptr<Scene> scene_;
  Prediction prediction_;
  double servo_rate_hz_;
  int period_;  ///< [ticks]

  // Of the servo loop.
  std::int64_t time_ = 0, next_ = 0;
  std::uint32_t session_ = 0;
  bool first_ = true;       ///< the next tick
  bool virtual_ = true;     ///< the clock, until the loop says which it is
  Answer newest_, before_;  ///< number 0: none
  Question question_;       ///< the newest
  bool unsent_ = false;     ///< it was not handed over
  std::vector<Contact> predicted_;
  std::uint64_t late_ = 0, stale_ = 0;  ///< answers, ticks

  Answer served_;  ///< the last, of whoever answers
  Mailbox<Question> questions_;
  Mailbox<Answer> answers_;
  std::atomic<std::uint32_t> asked_{0}, answered_{0};  ///< numbers of questions
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace haptrace
