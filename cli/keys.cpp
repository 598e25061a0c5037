#include "cli/keys.h"

#include "base/printable.h"
#include "formats/recording/recording.h"

#include <algorithm>
#include <array>
#include <csignal>
#include <fmt/format.h>
#include <poll.h>
#include <string_view>
#include <termios.h>
#include <unistd.h>

namespace haptrace::cli {

/// Switches off lines and echo of standard input; Ctrl+C stays a signal.
struct Keys::Terminal {
  termios before{};

  Terminal() {
    tcgetattr(STDIN_FILENO, &before);
    termios raw = before;
    raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    raw.c_cc[VMIN] = 1;
    raw.c_cc[VTIME] = 0;
    tcsetattr(STDIN_FILENO, TCSANOW, &raw);
  }
  ~Terminal() { tcsetattr(STDIN_FILENO, TCSANOW, &before); }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;
};

std::span<const Keys::Binding> Keys::play_keys() {
  static constexpr std::array<Binding, 6> kKeys{{{"+]", "gains * 1.1"},
                                                 {"-[", "gains / 1.1"},
                                                 {"o", "observer toggle"},
                                                 {"l", "learning toggle"},
                                                 {"f", "feedforward toggle"},
                                                 {"r", "reset"}}};
  return kKeys;
}

std::span<const Keys::Binding> Keys::guide_keys() {
  static constexpr std::array<Binding, 7> kKeys{{{"+]", "stiffness * 1.1"},
                                                 {"-[", "stiffness / 1.1"},
                                                 {"w", "radius * 1.1"},
                                                 {"n", "radius / 1.1"},
                                                 {"s", "skip"},
                                                 {"a", "repeat"},
                                                 {"r", "reset"}}};
  return kKeys;
}

Keys::Keys(std::shared_ptr<Annotations> annotations, std::vector<std::string> texts, bool always, Commands& commands,
           std::span<const Binding> bindings)
    : annotations_(std::move(annotations)), texts_(std::move(texts)), commands_(commands), bindings_(bindings) {
  // The system stops a background process that reads its terminal, with a force in the motors.
  const bool foreground = isatty(STDIN_FILENO) != 0 && tcgetpgrp(STDIN_FILENO) == getpgrp();
  if (foreground) terminal_ = std::make_unique<Terminal>();
  if (foreground || (always && isatty(STDIN_FILENO) == 0))
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

Keys::~Keys() = default;

std::string Keys::letters() const {
  std::string letters;
  for (const Binding& binding : bindings_) letters += binding.keys.front();
  return letters;
}

std::string Keys::typing() const {
  const std::lock_guard lock(mutex_);
  return typing_ ? "mark: " + text_ + "_" : std::string();
}

void Keys::run(const std::stop_token& stop) {
  constexpr int kPatience = 50;  // [ms]
  while (!stop.stop_requested()) {
    pollfd input{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
    if (poll(&input, 1, kPatience) <= 0) continue;
    char key = 0;
    if (read(STDIN_FILENO, &key, 1) <= 0) return;
    const bool typing = !this->typing().empty();
    if (typing)
      type(key);
    else
      press(key);
  }
}

void Keys::press(char key) {
  if (key == 'q') (void)kill(getpid(), SIGINT);
  if (answer(key)) return;
  if (annotations_) annotate(key);
  command(key);
}

bool Keys::offers(const std::string& action) const {
  const std::vector<std::string> actions = commands_.actions();
  return std::find(actions.begin(), actions.end(), action) != actions.end();
}

bool Keys::answer(char key) {
  if ((key != '1' && key != '2') || !offers("first")) return false;
  give(key, key == '1' ? "first" : "second");
  return true;
}

void Keys::command(char key) {
  // Others may pause and resume as well.
  if (key == 'p') return give(key, offers("resume") ? "resume" : "pause");
  for (const Binding& binding : bindings_)
    if (binding.keys.find(key) != std::string_view::npos) give(key, binding.command);
}

void Keys::give(char key, std::string_view command) {
  const std::string answer = commands_.obey(command);
  if (answer.starts_with("error") || answer.find(" clamped ") != std::string::npos)
    commands_.tell(fmt::format("key {}: {}", key, answer));
}

void Keys::annotate(char key) {
  if (key == 'm' || key == ' ') {
    annotations_->mark(fmt::format("mark {}", ++marks_));
  } else if (key >= '1' && key <= '9') {
    const auto index = static_cast<std::size_t>(key - '1');
    annotations_->mark(index < texts_.size() ? texts_[index] : fmt::format("mark {}", key));
  } else if (key == 't') {
    typed_at_ns_ = annotations_->now();
    const std::lock_guard lock(mutex_);
    typing_ = true;
    text_.clear();
  }
}

void Keys::type(char key) {
  constexpr char kEscape = 27, kDelete = 127;
  const std::lock_guard lock(mutex_);
  if (key == '\n' || key == '\r') {
    typing_ = false;
    // If the limit cut a character in two, drop its first part. Leave a text in another encoding as it is.
    if (const std::size_t at = find_invalid_utf8(text_); text_.size() > kLongestEventText - 3 && at + 3 >= text_.size())
      text_.resize(std::min(text_.size(), at));
    annotations_->mark(text_, typed_at_ns_);
  } else if (key == kEscape) {
    typing_ = false;
  } else if (key == kDelete || key == '\b') {
    if (!text_.empty()) text_.resize(utf8_prefix(text_, text_.size() - 1).size());
  } else if (text_.size() < kLongestEventText) {  // what is shown is what is kept
    text_ += key;
  }
}

}  // namespace haptrace::cli
