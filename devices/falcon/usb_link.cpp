#include "devices/falcon/usb_link.h"

#include "base/error.h"
#include "devices/loop/clock.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <libusb.h>
#include <poll.h>
#include <unistd.h>
#include <vector>

namespace haptrace {
namespace {

constexpr int kFalconInterface = 0;
constexpr std::uint8_t kFalconOut = 0x02, kFalconIn = 0x81;
constexpr std::size_t kFtdiStatus = 2;  // bytes at the beginning of every packet
constexpr std::size_t kLargestPacket = 512;
constexpr std::size_t kReceivers = 4;        // transfers in flight
constexpr std::size_t kMostReceived = 4096;  // largest number of unread bytes
constexpr unsigned kControlTimeout = 1000;   // [ms]
constexpr double kCancelTime = 1;            // time for the kernel to return a transfer [s]

template <auto function>
struct UsbCall {
  template <class Object>
  void operator()(Object* object) const noexcept {
    function(object);
  }
};
using UsbContext = std::unique_ptr<libusb_context, UsbCall<libusb_exit>>;
using UsbHandle = std::unique_ptr<libusb_device_handle, UsbCall<libusb_close>>;
using UsbTransfer = std::unique_ptr<libusb_transfer, UsbCall<libusb_free_transfer>>;

/// Deadline of a wait.
class UsbDeadline {
 public:
  explicit UsbDeadline(double seconds) : end_ns_(monotonic_ns() + static_cast<std::int64_t>(1e9 * seconds)) {}
  [[nodiscard]] double left() const noexcept {
    return 1e-9 * static_cast<double>(std::max<std::int64_t>(0, end_ns_ - monotonic_ns()));
  }

 private:
  std::int64_t end_ns_;
};

const char* falcon_request_text(FalconLink::Request request) noexcept {
  switch (request) {
    case FalconLink::Request::purge:
      return "to clear its buffers";
    case FalconLink::Request::modem:
      return "to set its modem lines";
    case FalconLink::Request::flow:
      return "to set its flow control";
    case FalconLink::Request::baud:
      return "to set its baud rate";
    case FalconLink::Request::line:
      return "to set its line format";
    case FalconLink::Request::latency_timer:
      return "to set its latency timer";
  }
  return "a request";
}

/// Returns for example "end falcon_demo (process 1234)". Programs of other users are not visible.
std::string usb_holder_remedy(const std::string& node) {
  namespace fs = std::filesystem;
  std::error_code error;
  const std::string own = std::to_string(getpid());
  for (fs::directory_iterator process("/proc", error), end; !error && process != end; process.increment(error)) {
    std::error_code hidden;
    for (fs::directory_iterator file(process->path() / "fd", hidden), last; !hidden && file != last;
         file.increment(hidden)) {
      std::error_code gone;
      if (fs::read_symlink(file->path(), gone) != node || process->path().filename() == own) continue;
      std::string name;
      std::getline(std::ifstream(process->path() / "comm"), name);
      if (name.starts_with("haptrace-guardi")) continue;  // truncated by the kernel; the guardian ends with its host
      return fmt::format("end {} (process {})", name, process->path().filename().string());
    }
  }
  return fmt::format("end it; sudo fuser -v {} names it", node);
}

class UsbFalconLink final : public FalconLink {
 public:
  explicit UsbFalconLink(const FalconPort& port);
  ~UsbFalconLink() override { close(); }

  void control(Request request, std::uint16_t value) override;
  bool write(std::span<const std::uint8_t> bytes, double timeout) override;
  std::size_t read(std::span<std::uint8_t> bytes, double timeout) override;
  std::optional<GuardedPort> guarded_port() const noexcept override;
  void close() noexcept override;

 private:
  /// A transfer and its buffer, which the kernel uses while the transfer is pending.
  struct Channel {
    UsbFalconLink* link = nullptr;
    UsbTransfer transfer;
    std::array<std::uint8_t, kLargestPacket> buffer{};
    bool pending = false;
  };

  static void LIBUSB_CALL completed(libusb_transfer* transfer) noexcept;
  void received(Channel& channel) noexcept;

  [[nodiscard]] Error lost(const std::string& why) const {
    return device_error(fmt::format("Novint Falcon at {}: {}", where_, why));
  }
  void open(const FalconPort& port);
  void prepare(Channel& channel, std::uint8_t endpoint, std::size_t length);
  int submit(Channel& channel) noexcept;
  void cancel(Channel& channel) noexcept;
  void clear_halt(std::uint8_t endpoint);
  void keep_receiving();
  void expect_here() const;
  void handle_events(double seconds);
  [[nodiscard]] bool send(std::span<const std::uint8_t> piece, const UsbDeadline& deadline);

  std::string where_;
  UsbContext context_;
  UsbHandle handle_;
  std::size_t packet_ = 64;  ///< packet size of the endpoints [bytes]
  std::array<Channel, kReceivers> receivers_;
  Channel sender_;
  std::vector<std::uint8_t> received_;
  bool stalled_ = false;  ///< the receiving endpoint has stalled
  bool gone_ = false, closing_ = false;
};

UsbFalconLink::UsbFalconLink(const FalconPort& port) : where_("usb " + port.port) {
  open(port);
  for (Channel& receiver : receivers_) prepare(receiver, kFalconIn, packet_);
  prepare(sender_, kFalconOut, 0);
  received_.reserve(kMostReceived);
}

void UsbFalconLink::open(const FalconPort& port) {
  libusb_context* context = nullptr;
  if (const int error = libusb_init(&context); error != 0)
    throw lost(fmt::format("libusb cannot start: {}", libusb_strerror(error)));
  context_.reset(context);

  libusb_device** devices = nullptr;
  const ssize_t count = libusb_get_device_list(context, &devices);
  int error = LIBUSB_ERROR_NO_DEVICE;
  for (ssize_t i = 0; i < count; ++i) {
    if (libusb_get_bus_number(devices[i]) != port.bus || libusb_get_device_address(devices[i]) != port.address)
      continue;
    libusb_device_handle* handle = nullptr;
    error = libusb_open(devices[i], &handle);
    handle_.reset(handle);
    const int largest = libusb_get_max_packet_size(devices[i], kFalconIn);
    if (largest > static_cast<int>(kFtdiStatus)) packet_ = std::min(static_cast<std::size_t>(largest), kLargestPacket);
  }
  libusb_free_device_list(devices, 1);
  if (error == LIBUSB_ERROR_NO_DEVICE) throw lost("it was unplugged while it was opened; plug it in again");
  if (error != 0) throw lost(fmt::format("{} cannot be opened: {}", port.node, libusb_strerror(error)));

  (void)libusb_set_auto_detach_kernel_driver(handle_.get(), port.driver == kFtdiDriver ? 1 : 0);
  error = libusb_claim_interface(handle_.get(), kFalconInterface);
  if (error == LIBUSB_ERROR_BUSY) throw lost("another program uses it: " + usb_holder_remedy(port.node));
  if (error != 0) throw lost(fmt::format("it cannot be claimed: {}; plug it in again", libusb_strerror(error)));
}

void UsbFalconLink::prepare(Channel& channel, std::uint8_t endpoint, std::size_t length) {
  channel.link = this;
  channel.transfer.reset(libusb_alloc_transfer(0));
  if (channel.transfer == nullptr) throw std::bad_alloc();
  libusb_fill_bulk_transfer(channel.transfer.get(), handle_.get(), endpoint, channel.buffer.data(),
                            static_cast<int>(length), completed, &channel, 0);
}

void LIBUSB_CALL UsbFalconLink::completed(libusb_transfer* transfer) noexcept {
  Channel& channel = *static_cast<Channel*>(transfer->user_data);
  channel.pending = false;
  if (transfer->status == LIBUSB_TRANSFER_NO_DEVICE) channel.link->gone_ = true;
  if (transfer->endpoint == kFalconIn) channel.link->received(channel);
}

void UsbFalconLink::received(Channel& channel) noexcept {
  const auto status = channel.transfer->status;
  stalled_ = stalled_ || status == LIBUSB_TRANSFER_STALL;
  // After an error on the bus, the next read submits the transfer again.
  if (status != LIBUSB_TRANSFER_COMPLETED) return;
  const auto length = static_cast<std::size_t>(channel.transfer->actual_length);
  const std::size_t count = strip_ftdi_status(std::span(channel.buffer).first(length), packet_);
  if (received_.size() + count > kMostReceived) received_.clear();  // nothing reads these bytes
  received_.insert(received_.end(), channel.buffer.data(), channel.buffer.data() + count);
  if (!closing_) submit(channel);
}

int UsbFalconLink::submit(Channel& channel) noexcept {
  const int error = libusb_submit_transfer(channel.transfer.get());
  channel.pending = error == 0;
  gone_ = gone_ || error == LIBUSB_ERROR_NO_DEVICE;
  return error;
}

void UsbFalconLink::cancel(Channel& channel) noexcept {
  if (!channel.pending) return;
  (void)libusb_cancel_transfer(channel.transfer.get());
  const UsbDeadline deadline(kCancelTime);
  while (channel.pending && deadline.left() > 0) {
    timeval wait{0, 10'000};
    (void)libusb_handle_events_timeout_completed(context_.get(), &wait, nullptr);
  }
  gone_ = gone_ || channel.pending;  // the kernel does not return the transfer
}

void UsbFalconLink::clear_halt(std::uint8_t endpoint) {
  gone_ = gone_ || libusb_clear_halt(handle_.get(), endpoint) == LIBUSB_ERROR_NO_DEVICE;
  expect_here();
}

void UsbFalconLink::keep_receiving() {
  expect_here();
  if (stalled_) {
    for (Channel& receiver : receivers_) cancel(receiver);
    stalled_ = false;
    clear_halt(kFalconIn);
  }
  for (Channel& receiver : receivers_)
    if (!receiver.pending) submit(receiver);
  expect_here();
}

void UsbFalconLink::expect_here() const {
  if (handle_ == nullptr) throw lost("the link is closed");
  if (gone_) throw lost("it was unplugged or has lost its power; plug it in again");
}

void UsbFalconLink::handle_events(double seconds) {
  timeval wait{};
  wait.tv_sec = static_cast<time_t>(seconds);
  wait.tv_usec = static_cast<suseconds_t>(1e6 * (seconds - static_cast<double>(wait.tv_sec)));
  const int error = libusb_handle_events_timeout_completed(context_.get(), &wait, nullptr);
  if (error != 0 && error != LIBUSB_ERROR_INTERRUPTED)
    throw lost(fmt::format("USB communication failed: {}; plug it in again", libusb_strerror(error)));
}

void UsbFalconLink::control(Request request, std::uint16_t value) {
  keep_receiving();
  constexpr std::uint8_t kVendorOut =
      LIBUSB_ENDPOINT_OUT | std::uint8_t{LIBUSB_REQUEST_TYPE_VENDOR} | LIBUSB_RECIPIENT_DEVICE;
  const int error = libusb_control_transfer(handle_.get(), kVendorOut, static_cast<std::uint8_t>(request), value, 0,
                                            nullptr, 0, kControlTimeout);
  gone_ = gone_ || error == LIBUSB_ERROR_NO_DEVICE;
  expect_here();
  if (error < 0)
    throw lost(fmt::format("its USB chip refuses {} ({:#06x}): {}; plug it in again", falcon_request_text(request),
                           value, libusb_strerror(error)));
}

bool UsbFalconLink::write(std::span<const std::uint8_t> bytes, double timeout) {
  const UsbDeadline deadline(timeout);
  keep_receiving();
  while (!bytes.empty()) {
    const auto piece = bytes.first(std::min(bytes.size(), sender_.buffer.size()));
    if (!send(piece, deadline)) return false;
    bytes = bytes.subspan(piece.size());
  }
  return true;
}

bool UsbFalconLink::send(std::span<const std::uint8_t> piece, const UsbDeadline& deadline) {
  libusb_transfer& transfer = *sender_.transfer;
  std::copy(piece.begin(), piece.end(), sender_.buffer.begin());
  transfer.length = static_cast<int>(piece.size());
  do {
    if (const int error = submit(sender_); error != 0) {
      expect_here();
      throw lost(fmt::format("USB accepts no data: {}; plug it in again", libusb_strerror(error)));
    }
    do {
      handle_events(deadline.left());
    } while (sender_.pending && deadline.left() > 0);
    cancel(sender_);
    expect_here();
    if (transfer.status != LIBUSB_TRANSFER_STALL)
      return transfer.status == LIBUSB_TRANSFER_COMPLETED && transfer.actual_length == transfer.length;
    clear_halt(kFalconOut);
  } while (deadline.left() > 0);
  return false;
}

std::size_t UsbFalconLink::read(std::span<std::uint8_t> bytes, double timeout) {
  const UsbDeadline deadline(timeout);
  for (bool waits = true; waits && received_.empty();) {
    keep_receiving();
    const double left = deadline.left();
    handle_events(left);
    waits = left > 0;
  }
  const std::size_t count = std::min(bytes.size(), received_.size());
  const auto end = received_.begin() + static_cast<std::ptrdiff_t>(count);
  std::copy(received_.begin(), end, bytes.begin());
  received_.erase(received_.begin(), end);
  if (count == 0) expect_here();
  return count;
}

/// Returns the file by which libusb accesses the device: the only one of its context that it polls for writing.
std::optional<GuardedPort> UsbFalconLink::guarded_port() const noexcept {
  if (handle_ == nullptr) return std::nullopt;
  std::optional<GuardedPort> port;
  const libusb_pollfd** files = libusb_get_pollfds(context_.get());
  for (const libusb_pollfd** file = files; file != nullptr && *file != nullptr; ++file)
    if (((*file)->events & POLLOUT) != 0) port = GuardedPort{.descriptor = (*file)->fd, .endpoint = kFalconOut};
  libusb_free_pollfds(files);
  return port;
}

void UsbFalconLink::close() noexcept {
  if (handle_ == nullptr) return;
  closing_ = true;
  cancel(sender_);
  for (Channel& receiver : receivers_)
    if (receiver.pending) (void)libusb_cancel_transfer(receiver.transfer.get());
  for (Channel& receiver : receivers_) cancel(receiver);
  (void)libusb_release_interface(handle_.get(), kFalconInterface);
  handle_.reset();
}

}  // namespace

std::unique_ptr<FalconLink> open_usb_falcon_link(const FalconPort& port) {
  expect_open_falcon_port(port);
  return std::make_unique<UsbFalconLink>(port);
}

std::size_t strip_ftdi_status(std::span<std::uint8_t> bytes, std::size_t packet) noexcept {
  std::size_t kept = 0;
  for (std::size_t begin = 0; begin < bytes.size(); begin += packet) {
    const std::size_t end = std::min(begin + packet, bytes.size());
    for (std::size_t i = begin + kFtdiStatus; i < end; ++i) bytes[kept++] = bytes[i];
  }
  return kept;
}

}  // namespace haptrace
