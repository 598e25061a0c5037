#include "cli/tuning.h"

#include "base/error.h"
#include "player/tuning/private_socket.h"

#include <filesystem>
#include <fmt/format.h>

namespace haptrace::cli {

void TuningArguments::add_to(CLI::App& app, bool gains) {
  socket_option = app.add_option("--tune-socket", socket,
                                 "read commands such as 'kp 2000' from a Unix socket that only this user can open "
                                 "(default path: $XDG_RUNTIME_DIR/haptrace/tune.sock)")
                      ->type_name("[PATH]")
                      ->expected(0, 1)
                      ->group("Tuning");
  app.add_option("--tune-port", port,
                 "read the same commands from a TCP port on this machine only; a client's first line must be the "
                 "session's token (0: any free port, which is printed)")
      ->type_name("PORT")
      ->group("Tuning");
  app.add_option("--tune-token-file", token_file,
                 "token file for --tune-port, written if it does not exist (default: a new token for every session)")
      ->type_name("FILE")
      ->group("Tuning");
  app.add_option("--tune-file", file, "read the same commands from this file, one per line, whenever it changes")
      ->type_name("FILE")
      ->group("Tuning");
  if (gains) app.add_flag("--expert", expert, "allow any gains while tuning")->group("Tuning");
}

TuningInputs::TuningInputs(const TuningArguments& arguments, Commands& commands) : example_(arguments.example) {
  if (!arguments.token_file.empty() && arguments.port.empty())
    throw input_error("--tune-token-file applies to --tune-port; give --tune-port as well");
  // Apply the file first: its settings are in force before the session starts.
  if (!arguments.file.empty()) file_.emplace(commands, arguments.file);
  const bool on_socket = arguments.socket_option != nullptr && arguments.socket_option->count() > 0;
  if (!on_socket && arguments.port.empty()) return;
  try {
    if (on_socket) socket_ = arguments.socket.empty() ? runtime_folder() + "/tune.sock" : arguments.socket;
    listen(arguments, commands);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}{}{}: {}", on_socket ? "--tune-socket" : "",
                                          on_socket && !arguments.port.empty() ? " and " : "",
                                          arguments.port.empty() ? "" : "--tune-port", error.what()));
  }
}

void TuningInputs::listen(const TuningArguments& arguments, Commands& commands) {
  TuningServer::Options options{.socket = socket_};
  if (!arguments.port.empty()) {
    options.port = parse_tuning_port(arguments.port);
    token_file_ = arguments.token_file;
    const bool kept = !token_file_.empty() && std::filesystem::exists(std::filesystem::symlink_status(token_file_));
    options.token = token_ = kept ? read_tuning_token(token_file_) : new_tuning_token();
    if (!kept && !token_file_.empty()) write_tuning_token(token_, token_file_);
  }
  server_.emplace(commands, std::move(options));
  if (arguments.port.empty() || !token_file_.empty()) return;
  // No two servers share a port, so an existing token file is left from a session that died.
  token_file_ = fmt::format("{}/tune-{}.token", runtime_folder(), server_->port());
  std::filesystem::remove(token_file_);
  write_tuning_token(token_, token_file_);
  token_is_temporary_ = true;
}

TuningInputs::~TuningInputs() {
  std::error_code ignored;
  if (token_is_temporary_) std::filesystem::remove(token_file_, ignored);
}

std::vector<std::string> TuningInputs::hints() const {
  std::vector<std::string> hints;
  if (!socket_.empty())
    hints.push_back(fmt::format("tune on socket {0} : printf '{1}\\nquit\\n' | nc -U {0}", socket_, example_));
  if (!token_.empty())
    hints.push_back(
        fmt::format("tune on port {0} of this machine, token in {1} : printf 'token {2}\\n{3}\\nquit\\n' | "
                    "nc 127.0.0.1 {0}",
                    server_->port(), token_file_, token_, example_));
  return hints;
}

}  // namespace haptrace::cli
