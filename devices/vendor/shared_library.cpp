#include "devices/vendor/shared_library.h"

#include "base/error.h"

#include <algorithm>
#include <dlfcn.h>
#include <filesystem>
#include <fmt/format.h>
#include <string_view>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

struct LoadAttempt {
  void* handle = nullptr;
  std::string why_not;
};

LoadAttempt try_to_load(const std::string& place, SharedLibrary::Symbols symbols) {
  std::error_code error;
  const bool is_file = place.find('/') != std::string::npos;
  if (is_file && !fs::exists(place, error)) return {nullptr, "there is no such file"};
  // RTLD_NOW resolves all symbols now, and not in the tick.
  const int visible = symbols == SharedLibrary::Symbols::global ? RTLD_GLOBAL : RTLD_LOCAL;
  if (void* handle = dlopen(place.c_str(), RTLD_NOW | visible)) return {handle, ""};
  std::string why = dlerror();
  // If a dependency is missing, the message begins with the name of the dependency.
  const bool is_missing = !is_file && why.starts_with(place + ":") && why.find("No such file") != std::string::npos;
  if (is_missing) return {nullptr, "not in the system's folders"};
  if (why.starts_with(place + ": ")) why.erase(0, place.size() + 2);
  return {nullptr, why};
}

}  // namespace

void SharedLibrary::Close::operator()(void* library) const noexcept {
  if (unload == Unload::with_this) dlclose(library);
}

SharedLibrary::SharedLibrary(const std::string& what, const std::string& file, Unload unload, Symbols symbols)
    : what_(what), file_(file), handle_(nullptr, Close{unload}) {
  // The system would search its folders for a name without a slash.
  const LoadAttempt attempt = try_to_load(fs::absolute(file), symbols);
  if (attempt.handle == nullptr)
    throw device_error(fmt::format("{} {}: cannot be loaded: {}", what, file, attempt.why_not));
  handle_.reset(attempt.handle);
}

SharedLibrary::SharedLibrary(const WantedLibrary& wanted, Unload unload)
    : what_(wanted.what), handle_(nullptr, Close{unload}) {
  std::vector<std::string> looked;
  for (const std::string& place : wanted.places) {
    const LoadAttempt attempt = try_to_load(place, Symbols::local);
    looked.push_back(fmt::format("{} ({})", place, attempt.why_not));
    if (attempt.handle == nullptr) continue;
    file_ = place;
    handle_.reset(attempt.handle);
    return;
  }
  throw device_error(fmt::format("{} is missing or cannot be loaded; looked for {}; {}", what_, fmt::join(looked, ", "),
                                 wanted.remedy));
}

SharedLibrary::Symbol SharedLibrary::function(const char* name, const std::string& remedy) const {
  void* address = dlsym(handle_.get(), name);
  if (address == nullptr)
    throw device_error(fmt::format("{} {}: does not export '{}'; {}", what_, file_, name, remedy));
  return Symbol(address);
}

SharedLibrary::Symbol SharedLibrary::function_if_any(const char* name) const noexcept {
  return Symbol(dlsym(handle_.get(), name));
}

std::vector<std::string> library_files(const std::vector<std::string>& folders, const std::string& name) {
  std::vector<std::string> files;
  for (const std::string& folder : folders) {
    std::vector<std::string> here;
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error))
      if (entry->path().filename().string().starts_with(name)) here.push_back(entry->path());
    if (here.empty()) here.push_back(fs::path(folder) / name);
    // Compares lengths first, so that 3.10 counts as newer than 3.9.
    std::sort(here.begin(), here.end(), [](const std::string& a, const std::string& b) {
      return a.size() != b.size() ? a.size() > b.size() : a > b;
    });
    files.insert(files.end(), here.begin(), here.end());
  }
  return files;
}

}  // namespace haptrace
