// haptrace-guardian: devices/guardian/guardian.cpp starts it; never start it by hand. Standard input is the host's
// socket, standard output the device's port.
//
// The host sends the endpoint of a USB device (0: a serial port), then two texts, each after its length in two bytes.
// The guardian answers with kGuardianReady. Then the host sends signs of life, kGuardianSpeak and kGuardianGo; the end
// of the stream means that the host is gone. The exit code is 0 if the port took the last words or none were requested.
#include "devices/guardian/guardian.h"

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <linux/usbdevice_fs.h>
#include <poll.h>
#include <span>
#include <sys/ioctl.h>
#include <unistd.h>

namespace {

using Words = std::vector<std::uint8_t>;

// Number of words for a silent host: the device answers each, and nobody reads the answers.
constexpr int kWordsOfSilence = 3;
constexpr useconds_t kPause = 5000;         // [us]
constexpr int kPatienceWithThePort = 200;   // pauses
constexpr unsigned kTransferTime = 100;     // [ms]
constexpr int kPausesOfATransfer = 20;      // length of a transfer that timed out
constexpr useconds_t kLastBreath = 50'000;  // time for the port to send its last bytes [us]

Words hear(std::size_t count) {
  Words words(count);
  for (std::size_t heard = 0; heard < count;) {
    const ssize_t more = read(STDIN_FILENO, words.data() + heard, count - heard);
    if (more == 0 || (more < 0 && errno != EINTR)) exit(1);  // NOLINT: nothing was promised yet
    if (more > 0) heard += static_cast<std::size_t>(more);
  }
  return words;
}

Words hear_words() {
  const Words length = hear(2);
  return hear(length[0] + 256U * length[1]);
}

bool write_to_port(const Words& words) {
  int pauses = 0;
  for (std::size_t said = 0; said < words.size();) {
    const ssize_t more = write(STDOUT_FILENO, words.data() + said, words.size() - said);
    if (more > 0) said += static_cast<std::size_t>(more);
    if (more > 0 || errno == EINTR) continue;
    if (errno != EAGAIN || ++pauses > kPatienceWithThePort) return false;
    usleep(kPause);
  }
  return true;
}

/// Sends `words` by the ioctl that waits for its own transfer only, so that the host's transfers stay with the host.
bool send_to_endpoint(Words words, unsigned endpoint) {
  for (int pauses = 0; pauses < kPatienceWithThePort; ++pauses) {
    usbdevfs_bulktransfer transfer{
        .ep = endpoint, .len = static_cast<unsigned>(words.size()), .timeout = kTransferTime, .data = words.data()};
    const int taken = ioctl(STDOUT_FILENO, USBDEVFS_BULK, &transfer);
    if (taken >= 0) return taken == static_cast<int>(words.size());
    if (errno == ENODEV || errno == ESHUTDOWN) return false;
    if (errno == ETIMEDOUT) {
      pauses += kPausesOfATransfer;
      continue;
    }
    if (errno == EPIPE) ioctl(STDOUT_FILENO, USBDEVFS_CLEAR_HALT, &endpoint);
    usleep(kPause);
  }
  return false;
}

/// Sends `words`. Returns whether the port took them. A USB device acknowledges received bytes, a serial port does not.
bool say(const Words& words, unsigned endpoint) {
  return endpoint == 0 ? write_to_port(words) : send_to_endpoint(words, endpoint);
}

}  // namespace

int main() {
  for (const int signal : {SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGPIPE, SIGTSTP}) std::signal(signal, SIG_IGN);
  const unsigned endpoint = hear(1)[0];
  const Words when_silent = hear_words(), when_dead = hear_words();
  (void)!write(STDIN_FILENO, &haptrace::kGuardianReady, 1);
  int spoken = 0;
  while (true) {
    pollfd host{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
    const int patience = spoken < kWordsOfSilence ? static_cast<int>(1000 * haptrace::Guardian::kPatience) : -1;
    if (poll(&host, 1, patience) == 0) {
      (void)say(when_silent, endpoint);
      ++spoken;
      continue;
    }
    std::array<char, 256> signs{};
    const ssize_t count = read(STDIN_FILENO, signs.data(), signs.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) break;
    for (const char sign : std::span(signs).first(static_cast<std::size_t>(count))) {
      if (sign == haptrace::kGuardianGo) return 0;
      if (sign != haptrace::kGuardianSpeak) continue;
      const char said = say(when_silent, endpoint) ? haptrace::kGuardianSpoke : haptrace::kGuardianFailed;
      (void)!write(STDIN_FILENO, &said, 1);
    }
    spoken = 0;
  }
  const bool said = say(when_dead, endpoint);
  if (endpoint == 0) usleep(kLastBreath);
  return said ? 0 : 1;
}
