// The files that a scene names.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace haptrace {

/// Finds the files that a scene names, which lie beside the scene's own file, and keeps a list of them.
class SceneFiles {
 public:
  /// `folder` and `text` of the scene's own file; no folder: the current one.
  explicit SceneFiles(std::filesystem::path folder = {}, std::string text = {})
      : folder_(std::move(folder)), text_(std::move(text)) {}

  /// Returns the text of the scene's own file; empty if the scene has none.
  [[nodiscard]] const std::string& text() const noexcept { return text_; }

  /// Returns the folder of the scene's own file; empty: the current one.
  [[nodiscard]] const std::filesystem::path& folder() const noexcept { return folder_; }

  /// Returns the path of a file that the scene names, and adds it to the list.
  std::string find(const std::string& name) {
    const std::filesystem::path path(name);
    std::string found = (path.is_absolute() ? path : folder_ / path).string();
    for (const std::string& known : expected_)
      if (known == name || known.ends_with("/" + name)) found = known;
    used_.push_back(found);
    return found;
  }

  /// From now on the file that ends in this name is found at this path, wherever the scene's own file is.
  void expect(std::string path) { expected_.push_back(std::move(path)); }

  /// Returns the paths of all files that the scene named, in the order in which it named them.
  [[nodiscard]] const std::vector<std::string>& used() const noexcept { return used_; }

 private:
  std::filesystem::path folder_;
  std::string text_;
  std::vector<std::string> used_, expected_;
};

}  // namespace haptrace
