// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/revocations.h"

#include <openssl/x509.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/core/input_file.h"
#include "mapstore/core/pem.h"
#include "mapstore/server/file_state.h"

namespace shiftmap::server {
namespace {

constexpr std::size_t kMaxFileBytes = std::size_t{64} << 20;
constexpr std::chrono::seconds kLookEvery{1};

bool IsSignedByOne(X509_CRL* crl, const std::vector<std::shared_ptr<X509>>& authorities) {
  return std::any_of(authorities.begin(), authorities.end(), [&](const auto& authority) {
    return X509_NAME_cmp(X509_CRL_get_issuer(crl), X509_get_subject_name(authority.get())) == 0 &&
           X509_CRL_verify(crl, X509_get0_pubkey(authority.get())) == 1;
  });
}

}  // namespace

StatusOr<std::unique_ptr<Revocations>> Revocations::Read(const std::string& crl_path,
                                                         const std::string& authority_path,
                                                         JsonLog* log) {
  std::unique_ptr<Revocations> revocations(new Revocations(crl_path, authority_path, log));
  if (crl_path.empty()) return revocations;
  revocations->state_ = FileState(crl_path);
  SHIFTMAP_ASSIGN_OR_RETURN(revocations->lists_, revocations->Load());
  revocations->WarnOfOld();
  return revocations;
}

StatusOr<Revocations::Lists> Revocations::Load() const {
  const ForgottenErrors forgotten;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string authority_pem,
                            ReadInputFile("client CA", authority_path_, kMaxFileBytes));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem, ReadInputFile("CRL", crl_path_, kMaxFileBytes));
  const auto authorities = CertificatesOfPem(authority_pem);
  Lists lists = CrlsOfPem(pem);
  for (std::size_t i = 0; i < lists.size(); ++i) {
    if (!IsSignedByOne(lists[i].get(), authorities)) {
      return InvalidArgument("CRL '{}': list {}: not signed by an authority of '{}'",
                             crl_path_,
                             i + 1,
                             authority_path_);
    }
  }
  if (lists.empty()) return InvalidArgument("CRL '{}': expected a CRL in PEM", crl_path_);
  return lists;
}

// Who is on no list stays in, so a list that nobody renews has to be noticed: once for each.
void Revocations::WarnOfOld() {
  for (std::size_t i = 0; i < lists_.size(); ++i) {
    const ASN1_TIME* const next = X509_CRL_get0_nextUpdate(lists_[i].get());
    if (next == nullptr || X509_cmp_current_time(next) >= 0) continue;
    if (!warned_of_.insert(lists_[i].get()).second) continue;
    log_->Write(
        JsonLog::Level::kWarning, "CRL is out of date", {{"path", crl_path_}, {"list", i + 1}});
  }
}

void Revocations::ReloadIfChanged() {
  const Clock::time_point now = Clock::now();
  if (now - looked_ < kLookEvery) return;
  looked_ = now;
  WarnOfOld();
  const std::string state = FileState(crl_path_);
  if (state == state_) return;
  state_ = state;
  StatusOr<Lists> lists = Load();
  if (!lists.ok()) {
    log_->Write(JsonLog::Level::kError, "CRL unreadable", {{"message", Message(lists.status())}});
    return;
  }
  lists_ = *std::move(lists);
  warned_of_.clear();
  WarnOfOld();
  log_->Write(JsonLog::Level::kInfo, "CRL read", {{"path", crl_path_}, {"lists", lists_.size()}});
}

bool Revocations::IsRevoked(const ClientCertificate& certificate) {
  if (crl_path_.empty()) return false;
  const std::lock_guard lock(mutex_);
  ReloadIfChanged();
  X509* const x509 = certificate.x509.get();
  return std::any_of(lists_.begin(), lists_.end(), [&](const auto& crl) {
    X509_REVOKED* entry = nullptr;
    // An entry by serial number is the issuer's.
    return X509_NAME_cmp(X509_CRL_get_issuer(crl.get()), X509_get_issuer_name(x509)) == 0 &&
           X509_CRL_get0_by_cert(crl.get(), &entry, x509) == 1;
  });
}

}  // namespace shiftmap::server
