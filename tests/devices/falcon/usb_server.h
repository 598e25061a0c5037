// Server of the emulated USB bus for other processes.
#pragma once

#include <atomic>
#include <list>
#include <memory>
#include <string>
#include <thread>
#include <vector>

struct usbdevfs_urb;

namespace haptrace::test {

class UsbBus;
struct UsbReply;
struct UsbRequest;

/// Forwards requests of clients (usb_client.h) to the bus. When a client disconnects or is killed, the server closes
/// the client's file.
class UsbServer {
 public:
  UsbServer(UsbBus& bus, std::string path);
  ~UsbServer();
  UsbServer(const UsbServer&) = delete;
  UsbServer& operator=(const UsbServer&) = delete;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  struct Client {
    int line;
    int file = -1;  ///< descriptor in this process
  };
  struct Urb;  ///< a client's transfer

  void run();
  bool serve(Client& client);
  void answer(int file, UsbRequest& asked, UsbReply& reply);
  void let_go(const Client& client);

  UsbBus& bus_;
  std::string path_;
  int listener_ = -1;
  std::vector<Client> clients_;
  std::list<std::unique_ptr<Urb>> urbs_;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace haptrace::test
