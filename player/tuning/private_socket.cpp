#include "player/tuning/private_socket.h"

#include "base/descriptor.h"
#include "base/error.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>
#include <utility>

namespace haptrace {
namespace {

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path)
    throw input_error(fmt::format("{}: the path of a socket has 1 to {} bytes; choose a shorter path", path,
                                  sizeof address.sun_path - 1));
  std::memcpy(address.sun_path, path.data(), path.size());
  return address;
}

Error refused(const std::string& path) {
  return input_error(fmt::format("{}: the socket cannot be opened: {}", path, std::strerror(errno)));
}

/// Returns false if the socket refuses connections because no process listens on it any more.
bool is_alive(const sockaddr_un& address) {
  const Descriptor probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  return connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 ||
         errno != ECONNREFUSED;
}

/// Removes the file at the path if it is a dead socket of this user.
void make_room(const std::string& path, const sockaddr_un& address) {
  struct stat status {};
  if (lstat(path.c_str(), &status) != 0) return;
  if (!S_ISSOCK(status.st_mode) || status.st_uid != geteuid())
    throw input_error(path + ": exists and is not a socket of this user; choose another path");
  if (is_alive(address))
    throw input_error(path + ": another session listens on this socket; end it, or choose another path");
  if (unlink(path.c_str()) != 0 && errno != ENOENT) throw refused(path);
}

}  // namespace

std::string runtime_folder() {
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  std::string folder = runtime != nullptr && runtime[0] == '/' ? fmt::format("{}/haptrace", runtime)
                                                               : fmt::format("/tmp/haptrace-{}", geteuid());
  if (mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    throw input_error(fmt::format("{}: cannot be created: {}", folder, std::strerror(errno)));
  struct stat status {};
  if (lstat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode) || status.st_uid != geteuid() ||
      (status.st_mode & 0077U) != 0)
    throw input_error(folder + ": is not a folder that belongs to this user alone (mode 0700); remove it");
  return folder;
}

PrivateSocket::PrivateSocket(std::string path) : path_(std::move(path)) {
  const sockaddr_un address = address_of(path_);
  // Two sessions that start at once must not both replace a dead socket.
  const std::filesystem::path parent = std::filesystem::path(path_).parent_path();
  const Descriptor folder(open(parent.empty() ? "." : parent.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder.get() < 0) throw refused(path_);
  if (flock(folder.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw input_error(path_ + ": another session is opening a socket in this folder; try again");
  make_room(path_, address);
  try {
    bind_and_listen();
  } catch (...) {
    if (descriptor_ >= 0) close(descriptor_);
    throw;
  }
}

void PrivateSocket::bind_and_listen() {
  const sockaddr_un address = address_of(path_);
  descriptor_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  // bind() gives the path the mode of the socket: another user cannot connect at any time.
  if (descriptor_ < 0 || fchmod(descriptor_, 0600) != 0 ||
      bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    throw refused(path_);
  struct stat status {};
  if (lstat(path_.c_str(), &status) != 0) throw refused(path_);
  device_ = status.st_dev;
  inode_ = status.st_ino;
  if ((status.st_mode & 0077U) != 0 || listen(descriptor_, SOMAXCONN) != 0) {
    const int reason = errno;
    unlink(path_.c_str());
    errno = reason;
    throw refused(path_);
  }
}

PrivateSocket::~PrivateSocket() {
  if (descriptor_ >= 0) close(descriptor_);
  struct stat status {};
  if (lstat(path_.c_str(), &status) == 0 && status.st_dev == device_ && status.st_ino == inode_) unlink(path_.c_str());
}

int PrivateSocket::release() noexcept {
  return std::exchange(descriptor_, -1);
}

bool is_peer_trusted(int descriptor) noexcept {
  ucred peer{};
  socklen_t size = sizeof peer;
  return getsockopt(descriptor, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 && (peer.uid == geteuid() || peer.uid == 0);
}

}  // namespace haptrace
