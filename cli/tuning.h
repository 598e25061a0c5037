// Options to tune a running session from outside, and the inputs that they open.
#pragma once

#include "player/tuning/commands.h"
#include "player/tuning/tuning_file.h"
#include "player/tuning/tuning_server.h"

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace::cli {

struct TuningArguments {
  std::string socket, port, token_file, file;
  bool expert = false;
  std::string example = "kp 800";              ///< command in the hints
  const CLI::Option* socket_option = nullptr;  ///< may be given without a path

  /// Adds the options; `gains` adds --expert, which allows any gains.
  void add_to(CLI::App& app, bool gains = true);
};

/// The requested sockets and file, open during the lifetime of this object.
class TuningInputs {
 public:
  /// Throws Error(input) naming the option. Borrows `commands`.
  TuningInputs(const TuningArguments& arguments, Commands& commands);
  ~TuningInputs();
  TuningInputs(const TuningInputs&) = delete;
  TuningInputs& operator=(const TuningInputs&) = delete;

  /// Returns how to reach each socket: a sentence with an example for each.
  [[nodiscard]] std::vector<std::string> hints() const;

 private:
  void listen(const TuningArguments& arguments, Commands& commands);

  std::string socket_, token_, token_file_, example_;
  bool token_is_temporary_ = false;  ///< the destructor removes the token file
  std::optional<TuningServer> server_;
  std::optional<TuningFile> file_;
};

}  // namespace haptrace::cli
