"""The verdict of `consensus`: fits its constants and says what they are worth."""
