// Functions of a library that is not linked but looked for while the program runs.
#pragma once

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// A library that a user may have.
struct WantedLibrary {
  std::string what;                 ///< begins every message about it
  std::vector<std::string> places;  ///< each a file when it has a slash, else a name that the system looks for
  std::string remedy;               ///< what to do when it is in none of them
};

/// A library that is loaded.
///
/// Threads: as any value; a Symbol may be resolved in any. Not real-time; what it found is called like any function.
class SharedLibrary {
 public:
  enum class Unload {
    with_this,  ///< once this object is gone
    never,      ///< with the program: for libraries that may leave threads behind
  };
  enum class Symbols {
    local,   ///< not for other libraries
    global,  ///< for those that are loaded later, too
  };

  /// A function, of the type that it is assigned to: `int (*f)(double) = library.function("f")`.
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

  /// Loads a file, whatever folder the system looks into. `what` it is begins every message about it.
  /// Throws Error(device) when it cannot be loaded.
  SharedLibrary(const std::string& what, const std::string& file, Unload unload, Symbols symbols = Symbols::local);

  /// Loads it from the first of its places where it can be. Throws Error(device) naming every place, with why it was
  /// not that, and the remedy.
  SharedLibrary(const WantedLibrary& wanted, Unload unload);

  /// As it was loaded.
  [[nodiscard]] const std::string& file() const noexcept { return file_; }

  /// Throws Error(device) naming the library and the function, and `remedy`, when it has none of this name.
  [[nodiscard]] Symbol function(const char* name, const std::string& remedy = "it is another version of it") const;

  /// Null when it has none of this name.
  [[nodiscard]] Symbol function_if_any(const char* name) const noexcept;

 private:
  struct Close {
    Unload unload = Unload::with_this;
    void operator()(void* library) const noexcept;
  };

  std::string what_, file_;
  std::unique_ptr<void, Close> handle_;
};

/// The files in `folders` whose names begin with `name` ("libHD.so" finds libHD.so.3.4.0), newest version first; for a
/// folder without any, where it would be. So a message about them says where was looked.
std::vector<std::string> library_files(const std::vector<std::string>& folders, const std::string& name);

}  // namespace haptrace
