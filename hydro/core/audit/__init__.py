"""Thruster audit: is every command column connected to its thruster, with the direction of the file?"""
