"""How two scans of a place lie to each other."""

from revisit._core.registration import PreparedScan, Registration, RegistrationOptions, register_scans

__all__ = ['PreparedScan', 'Registration', 'RegistrationOptions', 'register_scans']
