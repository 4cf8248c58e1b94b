// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/sqlite.h"

#include <sqlite3.h>

namespace airslam {
namespace {

[[noreturn]] void Throw(sqlite3* handle, int result_code) {
  throw SqliteError(result_code & 0xff,
                    handle != nullptr ? sqlite3_errmsg(handle) : sqlite3_errstr(result_code));
}

}  // namespace

SqliteDatabase::SqliteDatabase(const std::filesystem::path& file, Mode mode) {
  const int flags = mode == Mode::kCreate
                        ? SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX
                        : SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX;
  const int result = sqlite3_open_v2(file.c_str(), &handle_, flags, nullptr);
  if (result != SQLITE_OK) {
    const std::string text = handle_ != nullptr ? sqlite3_errmsg(handle_) : "out of memory";
    sqlite3_close_v2(handle_);
    throw SqliteError(result & 0xff, text);
  }
  sqlite3_busy_timeout(handle_, 10'000);
}

SqliteDatabase::~SqliteDatabase() { sqlite3_close_v2(handle_); }

void SqliteDatabase::Execute(const std::string& sql) {
  const int result = sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr);
  if (result != SQLITE_OK) Throw(handle_, result);
}

std::int64_t SqliteDatabase::QueryInteger(const std::string& sql) {
  SqliteStatement statement(*this, sql);
  return statement.Step() ? statement.Integer(0) : 0;
}

std::string SqliteDatabase::QueryText(const std::string& sql) {
  SqliteStatement statement(*this, sql);
  return statement.Step() ? statement.Text(0) : "";
}

int SqliteDatabase::Changes() const { return sqlite3_changes(handle_); }

void SqliteStatement::Finalizer::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

SqliteStatement::SqliteStatement(SqliteDatabase& database, const std::string& sql)
    : database_(database) {
  sqlite3_stmt* statement = nullptr;
  const int result = sqlite3_prepare_v2(database.handle(), sql.c_str(),
                                        static_cast<int>(sql.size()), &statement, nullptr);
  statement_.reset(statement);
  Check(result);
}

void SqliteStatement::Check(int result_code) const {
  if (result_code != SQLITE_OK) Throw(database_.handle(), result_code);
}

void SqliteStatement::Bind(int parameter, std::int64_t value) {
  Check(sqlite3_bind_int64(statement_.get(), parameter, value));
}

void SqliteStatement::Bind(int parameter, double value) {
  Check(sqlite3_bind_double(statement_.get(), parameter, value));
}

void SqliteStatement::Bind(int parameter, std::string_view text) {
  Check(sqlite3_bind_text(statement_.get(), parameter, text.data(), static_cast<int>(text.size()),
                          SQLITE_STATIC));
}

void SqliteStatement::Bind(int parameter, std::span<const std::byte> blob) {
  // A null pointer would bind NULL: an empty blob needs another address.
  const void* data = blob.empty() ? "" : static_cast<const void*>(blob.data());
  Check(sqlite3_bind_blob64(statement_.get(), parameter, data, blob.size_bytes(), SQLITE_STATIC));
}

void SqliteStatement::BindNull(int parameter) {
  Check(sqlite3_bind_null(statement_.get(), parameter));
}

bool SqliteStatement::Step() {
  const int result = sqlite3_step(statement_.get());
  if (result == SQLITE_ROW) return true;
  if (result == SQLITE_DONE) return false;
  Throw(database_.handle(), result);
}

void SqliteStatement::Run() {
  try {
    while (Step()) {
    }
  } catch (const SqliteError&) {
    Reset();
    throw;
  }
  Reset();
}

void SqliteStatement::Reset() {
  sqlite3_reset(statement_.get());
  sqlite3_clear_bindings(statement_.get());
}

std::int64_t SqliteStatement::Integer(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

double SqliteStatement::Real(int column) const {
  return sqlite3_column_double(statement_.get(), column);
}

std::string SqliteStatement::Text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column));
  if (text == nullptr) return "";
  return {text, static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

std::span<const std::byte> SqliteStatement::Blob(int column) const {
  const void* data = sqlite3_column_blob(statement_.get(), column);
  if (data == nullptr) return {};
  return {static_cast<const std::byte*>(data),
          static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
}

bool SqliteStatement::IsNull(int column) const { return Type(column) == SQLITE_NULL; }

int SqliteStatement::columns() const { return sqlite3_column_count(statement_.get()); }

int SqliteStatement::Type(int column) const {
  return sqlite3_column_type(statement_.get(), column);
}

SqliteTransaction::SqliteTransaction(SqliteDatabase& database) : database_(database) {
  database_.Execute("BEGIN IMMEDIATE");
}

SqliteTransaction::~SqliteTransaction() {
  if (open_) sqlite3_exec(database_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

void SqliteTransaction::Commit() {
  database_.Execute("COMMIT");
  open_ = false;
}

}  // namespace airslam
