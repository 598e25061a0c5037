#include "tests/devices/falcon/usb_client.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <linux/ioctl.h>
#include <linux/usbdevice_fs.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

namespace haptrace::test {
namespace {

constexpr int kAboveOthers = 100;  // above the descriptors that the program may expect

/// Closes a socket without calling close(), which the test program replaces for files of the bus.
void close_line(int line) {
  syscall(SYS_close, line);
}

bool send_file(int socket, int fd) {
  char byte = 0;
  iovec text{&byte, 1};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> space{};
  msghdr message{};
  message.msg_iov = &text;
  message.msg_iovlen = 1;
  message.msg_control = space.data();
  message.msg_controllen = space.size();
  cmsghdr* rights = CMSG_FIRSTHDR(&message);
  rights->cmsg_level = SOL_SOCKET;
  rights->cmsg_type = SCM_RIGHTS;
  rights->cmsg_len = CMSG_LEN(sizeof(int));
  std::memcpy(CMSG_DATA(rights), &fd, sizeof fd);
  return sendmsg(socket, &message, MSG_NOSIGNAL) == 1;
}

int connect_to_bus(int fd) {
  const char* path = std::getenv(kUsbBusSocket);
  struct stat status {};
  if (path == nullptr || fstat(fd, &status) != 0 || !S_ISFIFO(status.st_mode)) return -1;
  const int low = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  const int line = fcntl(low, F_DUPFD_CLOEXEC, kAboveOthers);
  close_line(low);
  sockaddr_un bus{};
  bus.sun_family = AF_UNIX;
  std::strncpy(bus.sun_path, path, sizeof bus.sun_path - 1);
  if (connect(line, reinterpret_cast<const sockaddr*>(&bus), sizeof bus) == 0 && send_file(line, fd)) return line;
  close_line(line);
  return -1;
}

/// Converts a request and its `argument` to a message.
UsbRequest request_of(unsigned long request, const void* argument) {
  UsbRequest asked{.request = request};
  const void* memory = nullptr;
  if (request == USBDEVFS_SUBMITURB) {
    const auto& urb = *static_cast<const usbdevfs_urb*>(argument);
    asked.type = urb.type;
    asked.endpoint = urb.endpoint;
    asked.size = static_cast<std::uint32_t>(urb.buffer_length);
    memory = urb.buffer;
  } else if (request == USBDEVFS_BULK) {
    const auto& transfer = *static_cast<const usbdevfs_bulktransfer*>(argument);
    asked.endpoint = transfer.ep;
    asked.size = transfer.len;
    asked.timeout_ms = transfer.timeout;
    memory = transfer.data;
  } else if (request == USBDEVFS_CLAIMINTERFACE || request == USBDEVFS_RELEASEINTERFACE ||
             request == USBDEVFS_CLEAR_HALT) {
    asked.endpoint = *static_cast<const unsigned*>(argument);
  }
  asked.urb = reinterpret_cast<std::uintptr_t>(argument);
  asked.size = std::min<std::uint32_t>(asked.size, asked.data.size());
  if (asked.size > 0) std::memcpy(asked.data.data(), memory, asked.size);
  return asked;
}

void answer(const UsbReply& reply, unsigned long request, void* argument) {
  if (reply.result < 0) return;
  if (request == USBDEVFS_GET_CAPABILITIES) *static_cast<std::uint32_t*>(argument) = reply.size;
  if (request != USBDEVFS_REAPURBNDELAY) return;
  auto* urb = reinterpret_cast<usbdevfs_urb*>(static_cast<std::uintptr_t>(reply.urb));
  urb->status = reply.status;
  urb->actual_length = static_cast<int>(reply.size);
  if ((urb->endpoint & 0x80) != 0) std::memcpy(urb->buffer, reply.data.data(), reply.size);
  *static_cast<usbdevfs_urb**>(argument) = urb;
}

}  // namespace

int UsbClient::connection(int fd) {
  const auto known = connections_.find(fd);
  if (known != connections_.end()) return known->second;
  const int line = connect_to_bus(fd);
  if (line >= 0) connections_[fd] = line;
  return line;
}

bool UsbClient::adopt(int fd) {
  const std::scoped_lock lock(mutex_);
  return connection(fd) >= 0;
}

bool UsbClient::handle(int fd, unsigned long request, void* argument, int& result) {
  if (_IOC_TYPE(request) != 'U') return false;
  const std::scoped_lock lock(mutex_);
  const int line = connection(fd);
  if (line < 0) return false;
  const UsbRequest asked = request_of(request, argument);
  UsbReply reply{.result = -1, .error = ENODEV};
  if (send(line, &asked, sizeof asked, MSG_NOSIGNAL) == static_cast<ssize_t>(sizeof asked))
    while (recv(line, &reply, sizeof reply, 0) < 0 && errno == EINTR) {
    }
  answer(reply, request, argument);
  result = reply.result;
  if (result < 0) errno = reply.error;
  return true;
}

void UsbClient::forget(int fd) {
  const std::scoped_lock lock(mutex_);
  const auto known = connections_.find(fd);
  if (known == connections_.end()) return;
  const int line = known->second;
  connections_.erase(known);
  close_line(line);
}

}  // namespace haptrace::test
