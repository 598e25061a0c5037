#include "devices/serial/serial_port.h"

#include "base/error.h"
#include "devices/loop/clock.h"
#include "devices/serial/serial_ports.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/serial.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr double kLongestDrain = 0.05;  // [s]

struct SerialSpeed {
  int baud;
  speed_t code;
};
constexpr std::array kSerialSpeeds{SerialSpeed{9600, B9600},      SerialSpeed{57600, B57600},
                                   SerialSpeed{115200, B115200},  SerialSpeed{230400, B230400},
                                   SerialSpeed{500000, B500000},  SerialSpeed{1000000, B1000000},
                                   SerialSpeed{2000000, B2000000}};

Error port_error(const std::string& path, int cause, const std::string& remedy) {
  return device_error(fmt::format("{}: {}; {}", path, std::strerror(cause), remedy));
}

Error port_gone(const std::string& path, int cause) {
  return port_error(path, cause, "the port is gone: check its cable and its power");
}

/// Returns why the port cannot be opened, and what to do.
Error not_opened(const std::string& path, int cause) {
  switch (cause) {
    case ENOENT:
    case ENODEV:
    case ENXIO:
      return port_error(
          path, cause,
          fmt::format("there is no such port; {}. Check that the device is plugged in", describe(usb_serial_ports())));
    case EACCES:
    case EPERM:
      return port_error(path, cause, fmt::format("this user may not open it: {}", kSerialPermission));
    case EBUSY:
    case EWOULDBLOCK:
      return device_error(
          fmt::format("{}: in use by another program; end that program (fuser -v {} names it; ModemManager releases a "
                      "new port after some seconds)",
                      path, path));
    default:
      return port_error(path, cause, "it cannot be opened");
  }
}

}  // namespace

SerialPort::SerialPort(const std::string& path, int baud) : path_(path) {
  fd_ = open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) throw not_opened(path, errno);
  try {
    if (isatty(fd_) == 0) throw port_error(path, ENOTTY, "it is not a serial port; " + describe(usb_serial_ports()));
    // TIOCEXCL does not bind root; a lock on the file does.
    if (flock(fd_, LOCK_EX | LOCK_NB) != 0) throw not_opened(path, errno);
    if (tcgetattr(fd_, &found_) != 0) throw not_opened(path, errno);
    configure(baud);
    hurry();
  } catch (...) {
    ::close(fd_);
    throw;
  }
}

void SerialPort::configure(int baud) {
  const SerialSpeed* speed = nullptr;
  for (const SerialSpeed& known : kSerialSpeeds)
    if (known.baud == baud) speed = &known;
  if (speed == nullptr)
    throw device_error(fmt::format("{}: {} baud is not a supported speed of a serial port", path_, baud));
  termios raw = found_;
  cfmakeraw(&raw);
  raw.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS);
  raw.c_cflag |= CLOCAL | CREAD;
  raw.c_cc[VMIN] = raw.c_cc[VTIME] = 0;
  cfsetispeed(&raw, speed->code);
  cfsetospeed(&raw, speed->code);
  if (tcsetattr(fd_, TCSANOW, &raw) != 0)
    throw port_error(path_, errno, fmt::format("it does not accept {} baud", baud));
  ioctl(fd_, TIOCEXCL);
  discard_input();
}

/// Requests low latency, because FTDI's chips otherwise hold bytes back for 16 ms. Drivers without such a setting
/// refuse, which does not matter.
void SerialPort::hurry() noexcept {
  serial_struct driver{};
  if (ioctl(fd_, TIOCGSERIAL, &driver) != 0) return;
  const int found = driver.flags;
  driver.flags |= ASYNC_LOW_LATENCY;
  if (found != driver.flags && ioctl(fd_, TIOCSSERIAL, &driver) == 0) found_flags_ = found;
}

bool SerialPort::wait(short event, double timeout) const {
  if (fd_ < 0) throw device_error(path_ + ": the port is closed");
  const std::int64_t end = monotonic_ns() + std::llround(1e9 * timeout);
  while (true) {
    const std::int64_t left = std::max<std::int64_t>(end - monotonic_ns(), 0);
    const timespec time{left / 1'000'000'000, left % 1'000'000'000};
    pollfd port{.fd = fd_, .events = event, .revents = 0};
    const int count = ppoll(&port, 1, &time, nullptr);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw port_gone(path_, errno);
    if (count == 0) return false;
    if ((port.revents & event) != 0) return true;
    throw port_gone(path_, EIO);
  }
}

bool SerialPort::write(std::span<const std::uint8_t> bytes, double timeout) {
  const std::int64_t end = monotonic_ns() + std::llround(1e9 * timeout);
  while (!bytes.empty()) {
    if (!wait(POLLOUT, 1e-9 * static_cast<double>(std::max<std::int64_t>(end - monotonic_ns(), 0)))) return false;
    const ssize_t count = ::write(fd_, bytes.data(), bytes.size());
    if (count < 0 && errno != EAGAIN && errno != EINTR) throw port_gone(path_, errno);
    if (count > 0) bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
  return true;
}

std::size_t SerialPort::read(std::span<std::uint8_t> bytes, double timeout) {
  if (bytes.empty() || !wait(POLLIN, timeout)) return 0;
  const ssize_t count = ::read(fd_, bytes.data(), bytes.size());
  if (count > 0) return static_cast<std::size_t>(count);
  if (count == 0) throw port_gone(path_, EIO);  // hung up
  if (errno == EAGAIN || errno == EINTR) return 0;
  throw port_gone(path_, errno);
}

void SerialPort::discard_input() noexcept {
  tcflush(fd_, TCIFLUSH);
}

void SerialPort::close() noexcept {
  if (fd_ < 0) return;
  // tcdrain would wait for ever for a board that takes no more bytes.
  const std::int64_t end = monotonic_ns() + std::llround(1e9 * kLongestDrain);
  int left = 0;
  while (ioctl(fd_, TIOCOUTQ, &left) == 0 && left > 0 && monotonic_ns() < end) usleep(500);
  serial_struct driver{};
  if (found_flags_ && ioctl(fd_, TIOCGSERIAL, &driver) == 0) {
    driver.flags = *found_flags_;
    ioctl(fd_, TIOCSSERIAL, &driver);
  }
  tcsetattr(fd_, TCSANOW, &found_);
  ioctl(fd_, TIOCNXCL);
  ::close(fd_);
  fd_ = -1;
}

}  // namespace haptrace
