#include "devices/serial/emulated_line.h"

#include "base/error.h"
#include "devices/loop/clock.h"
#include "devices/loop/realtime.h"
#include "devices/loop/servo_session.h"

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr std::array<std::uint8_t, 3> kLineGarbage{0x01, 0xff, 0x7f};
constexpr std::uint8_t kFlippedBit = 0x02;
constexpr std::int64_t kLineWake = 500'000;  // [ns]

}  // namespace

EmulatedLine::EmulatedLine(std::unique_ptr<EmulatedBoard> board) : board_(std::move(board)) {
  master_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  std::array<char, 64> name{};
  if (master_ < 0 || grantpt(master_) != 0 || unlockpt(master_) != 0 ||
      ptsname_r(master_, name.data(), name.size()) != 0) {
    const int cause = errno;
    if (master_ >= 0) close(master_);
    throw device_error(fmt::format("no pseudo-terminal is available for the emulated board: {}", std::strerror(cause)));
  }
  path_ = name.data();
  // The terminal must not echo before a driver opens the port and after it closes it.
  termios raw{};
  tcgetattr(master_, &raw);
  cfmakeraw(&raw);
  tcsetattr(master_, TCSANOW, &raw);
  thread_ = std::thread([this] { run(); });
}

EmulatedLine::~EmulatedLine() {
  ending_ = true;
  thread_.join();
  if (master_ >= 0) close(master_);
}

void EmulatedLine::inject(Way way, Fault fault, int after) {
  const std::scoped_lock lock(plan_);
  planned_.push_back({way, fault, after});
}

void EmulatedLine::pass(Way way, const std::uint8_t* bytes, std::size_t count, std::vector<std::uint8_t>& passed) {
  const std::scoped_lock lock(plan_);
  for (std::size_t i = 0; i < count; ++i) {
    std::uint8_t byte = bytes[i];
    bool lost = false;
    for (auto planned = planned_.begin(); planned != planned_.end();) {
      if (planned->way != way || planned->after-- > 0) {
        ++planned;
        continue;
      }
      if (planned->fault == Fault::lose_byte) lost = true;
      if (planned->fault == Fault::flip_bit) byte ^= kFlippedBit;
      if (planned->fault == Fault::insert_garbage)
        passed.insert(passed.end(), kLineGarbage.begin(), kLineGarbage.end());
      planned = planned_.erase(planned);
    }
    if (!lost && !silent_) passed.push_back(byte);
  }
}

void EmulatedLine::send(const std::vector<std::uint8_t>& bytes) const noexcept {
  // Bytes that the host does not read are lost once the line is full, as with a board that does not wait.
  if (!bytes.empty()) (void)!write(master_, bytes.data(), bytes.size());
}

void EmulatedLine::run() noexcept {
  (void)request_realtime();
  const FlushDenormals flush;
  std::array<std::uint8_t, 512> bytes{};
  std::vector<std::uint8_t> heard, answer, sent;
  while (!ending_) {
    pollfd line{.fd = master_, .events = POLLIN, .revents = 0};
    const timespec wake{0, kLineWake};
    ppoll(&line, 1, &wake, nullptr);
    // While no driver has the port open, poll returns at once: the line is hung up.
    if ((line.revents & POLLIN) == 0 && line.revents != 0) clock_nanosleep(CLOCK_MONOTONIC, 0, &wake, nullptr);
    if (unplugged_ && master_ >= 0) {
      close(master_);
      master_ = -1;
    }
    if (cycle_power_.exchange(false)) board_->power_cycle();
    board_->advance(monotonic_ns());
    const ssize_t count = master_ >= 0 ? read(master_, bytes.data(), bytes.size()) : 0;
    if (count <= 0) continue;
    heard.clear();
    answer.clear();
    sent.clear();
    pass(Way::to_board, bytes.data(), static_cast<std::size_t>(count), heard);
    for (const std::uint8_t byte : heard) board_->receive(byte, answer);
    pass(Way::to_host, answer.data(), answer.size(), sent);
    send(sent);
  }
}

}  // namespace haptrace
