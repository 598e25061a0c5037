// A Unix socket and a folder that belong to one user.
#pragma once

#include <cstdint>
#include <string>

namespace haptrace {

/// Returns $XDG_RUNTIME_DIR/haptrace, or /tmp/haptrace-UID where that variable is not an absolute path. Creates the
/// folder with mode 0700. Throws Error(input): it cannot be created, is a link, belongs to another user, or is open to
/// others.
std::string runtime_folder();

/// A listening Unix stream socket at a path of mode 0600. The destructor removes the path if it is still this socket.
class PrivateSocket {
 public:
  /// Replaces a dead socket of this user. Throws Error(input): the path is too long or taken by a live socket, by a
  /// socket of another user or by any other file; the system refuses.
  explicit PrivateSocket(std::string path);
  ~PrivateSocket();
  PrivateSocket(const PrivateSocket&) = delete;
  PrivateSocket& operator=(const PrivateSocket&) = delete;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  /// Transfers the listening descriptor to the caller, which closes it. Call once.
  [[nodiscard]] int release() noexcept;

 private:
  void bind_and_listen();

  std::string path_;
  int descriptor_ = -1;
  std::uint64_t device_ = 0, inode_ = 0;  ///< identity of the path when it was created
};

/// Returns true when the process at the other end of a connected Unix socket runs as this user or as root.
bool is_peer_trusted(int descriptor) noexcept;

}  // namespace haptrace
