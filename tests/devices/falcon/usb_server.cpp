#include "tests/devices/falcon/usb_server.h"

#include "tests/devices/falcon/usb_bus.h"
#include "tests/devices/falcon/usb_client.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <linux/ioctl.h>
#include <linux/usbdevice_fs.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

namespace haptrace::test {
namespace {

constexpr int kLookMs = 20;  // interval of the checks for the end

/// Returns the descriptor in a client's first message, or -1.
int receive_file(int line) {
  char byte = 0;
  iovec text{&byte, 1};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> space{};
  msghdr message{};
  message.msg_iov = &text;
  message.msg_iovlen = 1;
  message.msg_control = space.data();
  message.msg_controllen = space.size();
  int fd = -1;
  if (recvmsg(line, &message, MSG_CMSG_CLOEXEC) != 1) return fd;
  if (const cmsghdr* rights = CMSG_FIRSTHDR(&message); rights != nullptr && rights->cmsg_type == SCM_RIGHTS)
    std::memcpy(&fd, CMSG_DATA(rights), sizeof fd);
  return fd;
}

}  // namespace

struct UsbServer::Urb {
  std::uint64_t name = 0;  ///< address of the transfer in the client
  int file = -1;
  std::vector<std::uint8_t> memory;
  std::unique_ptr<usbdevfs_urb> urb = std::make_unique<usbdevfs_urb>();
};

UsbServer::UsbServer(UsbBus& bus, std::string path) : bus_(bus), path_(std::move(path)) {
  listener_ = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  sockaddr_un name{};
  name.sun_family = AF_UNIX;
  std::strncpy(name.sun_path, path_.c_str(), sizeof name.sun_path - 1);
  if (bind(listener_, reinterpret_cast<const sockaddr*>(&name), sizeof name) != 0 || listen(listener_, 16) != 0)
    throw std::runtime_error("no socket at " + path_);
  thread_ = std::thread([this] { run(); });
}

UsbServer::~UsbServer() {
  ending_ = true;
  thread_.join();
  for (const Client& client : clients_) let_go(client);
  close(listener_);
}

void UsbServer::run() {
  while (!ending_) {
    std::vector<pollfd> lines{{.fd = listener_, .events = POLLIN, .revents = 0}};
    for (const Client& client : clients_) lines.push_back({.fd = client.line, .events = POLLIN, .revents = 0});
    if (poll(lines.data(), lines.size(), kLookMs) <= 0) continue;
    for (std::size_t i = lines.size(); --i > 0;) {
      if (lines[i].revents == 0) continue;
      const auto client = clients_.begin() + static_cast<std::ptrdiff_t>(i - 1);
      if (serve(*client)) continue;
      let_go(*client);
      clients_.erase(client);
    }
    if (lines[0].revents != 0)
      if (const int line = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC); line >= 0) clients_.push_back({line});
  }
}

void UsbServer::let_go(const Client& client) {
  close(client.line);
  if (client.file >= 0) close(client.file);
}

/// Serves one message; returns whether the client is still connected.
bool UsbServer::serve(Client& client) {
  if (client.file < 0) {
    client.file = receive_file(client.line);
    if (client.file < 0) return false;
    bus_.adopt(client.file);
    return true;
  }
  UsbRequest asked;
  if (recv(client.line, &asked, sizeof asked, 0) != static_cast<ssize_t>(sizeof asked)) return false;
  UsbReply reply;
  answer(client.file, asked, reply);
  return send(client.line, &reply, sizeof reply, MSG_NOSIGNAL) == static_cast<ssize_t>(sizeof reply);
}

void UsbServer::answer(int file, UsbRequest& asked, UsbReply& reply) {
  const auto ask = [&](void* argument) {
    errno = 0;
    if (!bus_.handle(file, asked.request, argument, reply.result)) {
      reply.result = -1;
      errno = ENODEV;
    }
    reply.error = errno;
    return reply.result >= 0;
  };
  if (asked.request == USBDEVFS_SUBMITURB) {
    auto made = std::make_unique<Urb>();
    made->name = asked.urb;
    made->file = file;
    made->memory.assign(asked.data.begin(), asked.data.begin() + asked.size);
    usbdevfs_urb& urb = *made->urb;
    urb.type = static_cast<unsigned char>(asked.type);
    urb.endpoint = static_cast<unsigned char>(asked.endpoint);
    urb.buffer = made->memory.data();
    urb.buffer_length = static_cast<int>(asked.size);
    urb.usercontext = made.get();
    urbs_.push_back(std::move(made));
    if (!ask(&urb)) urbs_.pop_back();
  } else if (asked.request == USBDEVFS_DISCARDURB) {
    const auto named = std::find_if(urbs_.begin(), urbs_.end(), [&](const std::unique_ptr<Urb>& urb) {
      return urb->name == asked.urb && urb->file == file;
    });
    reply.result = -1;
    reply.error = EINVAL;
    if (named != urbs_.end()) ask((*named)->urb.get());
  } else if (asked.request == USBDEVFS_REAPURBNDELAY) {
    usbdevfs_urb* urb = nullptr;
    if (!ask(&urb)) return;
    const auto* ended = static_cast<const Urb*>(urb->usercontext);
    reply.urb = ended->name;
    reply.status = urb->status;
    reply.size = static_cast<std::uint32_t>(urb->actual_length);
    std::copy_n(ended->memory.begin(), std::min<std::size_t>(reply.size, ended->memory.size()), reply.data.begin());
    urbs_.remove_if([&](const std::unique_ptr<Urb>& one) { return one.get() == ended; });
  } else if (asked.request == USBDEVFS_BULK) {
    usbdevfs_bulktransfer transfer{
        .ep = asked.endpoint, .len = asked.size, .timeout = asked.timeout_ms, .data = asked.data.data()};
    ask(&transfer);
  } else if (asked.request == USBDEVFS_GET_CAPABILITIES) {
    ask(&reply.size);
  } else {
    ask(&asked.endpoint);
  }
}

}  // namespace haptrace::test
