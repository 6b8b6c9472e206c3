from pathlib import Path


def play_scripted(*a):
    pass


def standing(*a):
    return ""


def write(*a):
    return Path()
