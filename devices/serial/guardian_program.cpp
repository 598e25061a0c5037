// haptrace-guardian: started by devices/serial/guardian.cpp, never by hand. Standard input is its host's socket,
// standard output the board's port.
//
// The socket brings two texts, each after its length in two bytes, and then signs of life. 'q' ends this program
// without a word; the end of the stream means that the host is gone.
#include "devices/serial/guardian.h"

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <poll.h>
#include <unistd.h>

namespace {

using Words = std::vector<std::uint8_t>;

constexpr int kWordsOfSilence =
    3;  // how often a silent host is spoken for: each one is answered, and nobody reads that
constexpr useconds_t kPause = 5000;         // [us]
constexpr int kPatienceWithThePort = 200;   // pauses
constexpr useconds_t kLastBreath = 50'000;  // for the port to send what it was given [us]

Words hear_words() {
  const auto hear = [](std::size_t count) {
    Words words(count);
    for (std::size_t heard = 0; heard < count;) {
      const ssize_t more = read(STDIN_FILENO, words.data() + heard, count - heard);
      if (more <= 0 && errno != EINTR) exit(1);  // NOLINT: nothing was promised yet
      if (more > 0) heard += static_cast<std::size_t>(more);
    }
    return words;
  };
  const Words length = hear(2);
  return hear(length[0] + 256U * length[1]);
}

void say(const Words& words) {
  int pauses = 0;
  for (std::size_t said = 0; said < words.size();) {
    const ssize_t more = write(STDOUT_FILENO, words.data() + said, words.size() - said);
    if (more > 0) said += static_cast<std::size_t>(more);
    if (more > 0 || errno == EINTR) continue;
    if (errno != EAGAIN || ++pauses > kPatienceWithThePort) return;
    usleep(kPause);
  }
}

}  // namespace

int main() {
  for (const int signal : {SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGPIPE, SIGTSTP}) std::signal(signal, SIG_IGN);
  const Words when_silent = hear_words(), when_dead = hear_words();
  int spoken = 0;
  while (true) {
    pollfd host{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
    const int patience = spoken < kWordsOfSilence ? static_cast<int>(1000 * haptrace::Guardian::kPatience) : -1;
    if (poll(&host, 1, patience) == 0) {
      say(when_silent);
      ++spoken;
      continue;
    }
    std::array<char, 256> signs{};
    const ssize_t count = read(STDIN_FILENO, signs.data(), signs.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) break;
    for (ssize_t i = 0; i < count; ++i)
      if (signs[static_cast<std::size_t>(i)] == 'q') return 0;
    spoken = 0;
  }
  say(when_dead);
  usleep(kLastBreath);
  return 0;
}
