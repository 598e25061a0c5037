// Libraries that are loaded at run time.
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// A library that may be installed, and the places to search for it.
struct WantedLibrary {
  std::string what;                 ///< name; begins every message about it
  std::vector<std::string> places;  ///< files if they contain a slash, otherwise names that the system searches for
  std::string remedy;               ///< what to do if the library is in none of them
};

/// A loaded library.
///
/// Threads: as any value; a Symbol may be resolved in any thread. Not real-time; the functions found are called like
/// any other.
class SharedLibrary {
 public:
  enum class Unload {
    with_this,  ///< unloads the library with this object
    never,      ///< keeps it until the program ends, for libraries that may leave threads behind
  };
  enum class Symbols {
    local,   ///< invisible to other libraries
    global,  ///< visible to libraries that are loaded later
  };

  /// A function, which converts to the type that it is assigned to: `int (*f)(double) = library.function("f")`.
  class Symbol {
   public:
    explicit Symbol(void* address) : address_(address) {}

    template <typename Function>
    operator Function*() const {  // NOLINT(google-explicit-constructor): the type stands where it is assigned
      return reinterpret_cast<Function*>(address_);
    }

   private:
    void* address_;
  };

  /// Loads a file, regardless of the system's folders. `what` begins every message about it. Throws Error(device) if
  /// the file cannot be loaded.
  SharedLibrary(const std::string& what, const std::string& file, Unload unload, Symbols symbols = Symbols::local);

  /// Loads the library from the first place that works. Throws Error(device) naming every place, why it failed, and the
  /// remedy.
  SharedLibrary(const WantedLibrary& wanted, Unload unload);

  /// Returns the file or name from which the library was loaded.
  [[nodiscard]] const std::string& file() const noexcept { return file_; }

  /// Returns a function. Throws Error(device) naming the library, the function and `remedy` if there is none of this
  /// name.
  [[nodiscard]] Symbol function(const char* name,
                                const std::string& remedy = "it is another version of the library") const;

  /// Returns a function; null if there is none of this name.
  [[nodiscard]] Symbol function_if_any(const char* name) const noexcept;

 private:
  struct Close {
    Unload unload = Unload::with_this;
    void operator()(void* library) const noexcept;
  };

  std::string what_, file_;
  std::unique_ptr<void, Close> handle_;
};

/// Returns the files in `folders` whose names begin with `name` ("libHD.so" finds libHD.so.3.4.0), newest version
/// first. For a folder without any, returns the path where it would be, so that a message names every place searched.
std::vector<std::string> library_files(const std::vector<std::string>& folders, const std::string& name);

}  // namespace haptrace
